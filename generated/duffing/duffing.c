#include "duffing_real.h"

const char *const duffing_model = "Duffing oscillator under white noise";
const char *const duffing_state_names[2] = {
    "x",
    "v"
};
const char *const duffing_parameter_names[4] = {
    "omega_n",
    "zeta",
    "epsilon",
    "Q"
};
const char *const duffing_output_names[1] = {
    "energy"
};
const R duffing_default_parameters[4] = {
    K(1.0), K(0.05), K(1.0), K(0.2)
};
const R duffing_duration = K(100.0);
const int duffing_points = 201;
const R duffing_start_speed = K(0.0);
const int duffing_jacobian_column[6] = {
    0, 3, 5, 8, 11, 13
};
const int duffing_jacobian_row[13] = {
    1, 3, 4, 0, 1, 1, 3, 4, 2, 3, 4, 3, 4
};
