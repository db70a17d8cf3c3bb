/* What cadet-sym computed; see test.c. */
static const double sample_t = 100.0;
static const double run_end = 100.0;
static const int breakpoint_count = 0;
static const double initial[5] = {
    0, 0, 0, 0, 0
};
static const double sample_y[5] = {
    -3.74773264e-27, 1.04159439e-26, 0.434254219, 6.59664083e-06, 1.00000061
};
static const double final[5] = {
    -3.74773264e-27, 1.04159439e-26, 0.434254219, 6.59664083e-06, 1.00000061
};
static const double rate[5] = {
    1.04159439e-26, 7.58854438181e-27, 1.319328166e-05, 1.55511780173e-05, -3.050299633e-05
};
static const double jacobian[13] = {
    -2.302762657, 9.76481226362e-27, 2.96669353835e-31, 1, -0.1, 1.124319792e-26, -3.605525314, -3.957984498e-05, 2,
    -0.1, -4.605525314, 1, -0.2
};
static const double output_mean[1] = {
    0.858559959539
};
static const double output_variance[1] = {
    1.05332678217
};
