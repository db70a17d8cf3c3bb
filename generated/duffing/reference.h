/* What cadet-sym computed; see test.c. */
static const double sample_t = 100.0;
static const double run_end = 100.0;
static const int breakpoint_count = 0;
static const double initial[5] = {
    0, 0, 0, 0, 0
};
static const double sample_y[5] = {
    4.34646444e-25, 5.34809012e-25, 0.43425422, 6.59454907e-06, 1.0000006
};
static const double final[5] = {
    4.34646444e-25, 5.34809012e-25, 0.43425422, 6.59454907e-06, 1.0000006
};
static const double rate[5] = {
    5.34809012e-25, -1.05436850274e-24, 1.318909814e-05, 1.55377816676e-05, -3.04913627159e-05
};
static const double jacobian[13] = {
    -2.30276266, -1.13248231509e-24, -3.43955676367e-29, 1, -0.1, -1.303939332e-24, -3.60552532, -3.956729442e-05,
    2, -0.1, -4.60552532, 1, -0.2
};
static const double output_mean[1] = {
    0.858559955691
};
static const double output_variance[1] = {
    1.05332677627
};
