/* What cadet-sym computed; see test.c. */
static const double sample_t = 25.0;
static const double run_end = 25.0;
static const int breakpoint_count = 0;
static const double initial[14] = {
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.909090909091, 3.10191473101e-15, 5.81818181818
};
static const double sample_y[14] = {
    -0.3394, 0.00773, 0, 0, 1.84969, -0.00287, -0.25255, -0.49135, 7.79523, 0.49136, -5.94025, 0.909091, 0, 5.81818
};
static const double final[14] = {
    -0.3394, 0.00773, 0, 0, 1.84969, -0.00287, -0.25255, -0.49135, 7.79523, 0.49136, -5.94025, 0.909091, 0, 5.81818
};
static const double size[14] = {
    1, 1, 0.1, 1, 1, 1, 1, 1, 1, 1, 1, 0.1, 1, 1
};
static const double rate[14] = {
    0.00773, -0.0134368451173, 0, 0, -0.00574, 0.00610268071983, 1e-05, -4.9999999999e-05, 0.00370156960633,
    -9.27911129125e-05, -0.000593642525885, 0, -2.40000000051e-06, 3.20000000045e-05
};
static const double jacobian[14] = {
    1, 8.12913609144, 1, -9.44, 2, 14.9345616959, 2, -14.2, 26.2165405423, 9.12219278409, -0.636309903728, 2, -8.44,
    -30.4
};
static const double output_mean[2] = {
    -0.3394, 0.352682245117
};
static const double output_variance[2] = {
    1.84969, 0.801544042232
};
