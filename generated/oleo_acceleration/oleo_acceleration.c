#include "oleo_acceleration_real.h"

const char *const oleo_acceleration_model = "Oleo undercarriage accelerating from rest";
const char *const oleo_acceleration_state_names[4] = {
    "x",
    "v",
    "h.height",
    "h.slope"
};
const char *const oleo_acceleration_parameter_names[5] = {
    "omega_n",
    "zeta",
    "gamma",
    "r",
    "a"
};
const char *const oleo_acceleration_output_names[2] = {
    "closure",
    "damper_force"
};
const R oleo_acceleration_default_parameters[5] = {
    K(10.0), K(0.01), K(0.1), K(0.1), K(8.0)
};
const R oleo_acceleration_duration = K(10.0);
const int oleo_acceleration_points = 101;
const R oleo_acceleration_start_speed = K(0.0);
const int oleo_acceleration_jacobian_column[15] = {
    0, 1, 7, 9, 12, 13, 16, 19, 23, 28, 32, 36, 38, 43, 46
};
const int oleo_acceleration_jacobian_row[46] = {
    1, 0, 1, 5, 8, 9, 10, 1, 3, 1, 2, 3, 5, 4, 5, 8, 5, 7, 9, 5, 6, 7, 10, 1, 5, 8, 9, 10, 6, 8, 9, 10, 7, 8, 9, 10,
    9, 12, 9, 10, 11, 12, 13, 10, 12, 13
};
