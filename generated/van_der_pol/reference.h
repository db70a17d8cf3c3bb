/* What cadet-sym computed; see test.c. */
static const double sample_t = 100.0;
static const double run_end = 100.0;
static const int breakpoint_count = 0;
static const double initial[5] = {
    0.1, 0, 0, 0, 0
};
static const double sample_y[5] = {
    0.00058, 0.00026, 1.24162, 0, 1.24162
};
static const double final[5] = {
    0.00058, 0.00026, 1.24162, 0, 1.24162
};
static const double size[5] = {
    1, 1, 1, 1, 1
};
static const double rate[5] = {
    0.00026, -0.000611410643732, 0, -1.87236296023e-07, -6.42080968005e-07
};
static const double jacobian[5] = {
    1, -1.121520319, 2, -1.3634732798, -3.4846809172
};
static const double output_mean[1] = {
    0.00058
};
static const double output_variance[1] = {
    1.24162
};
