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
static const double jacobian[16] = {
    -1.0000001508, -0.0003228212, -0.0014402792, 1, -0.1208101682, -0.0007201396, 0, -0.00013, -1.0000001508,
    -1.24162, -0.00058, 2, -1.3624301682, -2.0000003016, 1, -0.2416203364
};
static const double output_mean[1] = {
    0.00058
};
static const double output_variance[1] = {
    1.24162
};
