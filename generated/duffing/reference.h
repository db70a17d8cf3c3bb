/* What cadet-sym computed; see test.c. */
static const double sample_t = 100.0;
static const double run_end = 100.0;
static const int breakpoint_count = 0;
static const double initial[5] = {
    0, 0, 0, 0, 0
};
static const double sample_y[5] = {
    0, 0, 0.434254, 7e-06, 1
};
static const double final[5] = {
    0, 0, 0.434254, 7e-06, 1
};
static const double size[5] = {
    0.1, 1, 0.1, 0.1, 1
};
static const double rate[5] = {
    0, 0, 1.4e-05, 1.56904520001e-05, -3.2238668e-05
};
static const double jacobian[5] = {
    1, -0.3302762, 0.2, 0.6294476, -0.6605566
};
static const double output_mean[1] = {
    0.858559402387
};
static const double output_variance[1] = {
    1.05332527498
};
