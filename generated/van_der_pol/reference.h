/* What cadet-sym computed; see test.c. */
static const double sample_t = 100.0;
static const double run_end = 100.0;
static const int breakpoint_count = 0;
static const double initial[5] = {
    0.1, 0, 0, 0, 0
};
static const double sample_y[5] = {
    0.000577814728, 0.000258208824, 1.24161951, -1.49194545e-07, 1.24161978
};
static const double final[5] = {
    0.000577814728, 0.000258208824, 1.24161951, -1.49194545e-07, 1.24161978
};
static const double rate[5] = {
    0.000258208824, -0.000609008829664, -2.9838909e-07, 2.88021305028e-07, 3.20999760051e-07
};
static const double jacobian[16] = {
    -1, -0.000320597027326, -0.00143485231387, 1, -0.120809921935, -0.00071742603945, 1.72413610877e-10,
    -0.000129104412, -0.999999925405, -1.24161978, -0.000577814728, 2, -1.36242943193, -1.99999970162, 1,
    -0.24161984387
};
static const double output_mean[1] = {
    0.000577814728
};
static const double output_variance[1] = {
    1.24161951
};
