/* What cadet-sym computed; see test.c. */
static const double sample_t = 100.0;
static const double run_end = 100.0;
static const int breakpoint_count = 0;
static const double initial[5] = {
    0.1, 0, 0, 0, 0
};
static const double sample_y[5] = {
    0.000577816143, 0.000258209066, 1.24161951, -1.49197266e-07, 1.24161978
};
static const double final[5] = {
    0.000577816143, 0.000258209066, 1.24161951, -1.49197266e-07, 1.24161978
};
static const double rate[5] = {
    0.000258209066, -0.000609010273898, -2.98394532e-07, 2.88024385231e-07, 3.21003171821e-07
};
static const double jacobian[16] = {
    -1, -0.000320597327796, -0.00143485582766, 1, -0.120809921936, -0.000717427796342, 1.72417177573e-10,
    -0.000129104533, -0.999999925401, -1.24161978, -0.000577816143, 2, -1.36242943194, -1.99999970161, 1,
    -0.241619843871
};
static const double output_mean[1] = {
    0.000577816143
};
static const double output_variance[1] = {
    1.24161951
};
