#include "oleo_constant_speed_real.h"

const char *const oleo_constant_speed_model = "Oleo undercarriage at constant speed";
const char *const oleo_constant_speed_state_names[4] = {
    "x",
    "v",
    "h.height",
    "h.slope"
};
const char *const oleo_constant_speed_parameter_names[5] = {
    "omega_n",
    "zeta",
    "gamma",
    "r",
    "V"
};
const char *const oleo_constant_speed_output_names[2] = {
    "closure",
    "damper_force"
};
const R oleo_constant_speed_default_parameters[5] = {
    K(1.0), K(0.01), K(0.1), K(0.1), K(1.0)
};
const R oleo_constant_speed_duration = K(25.0);
const int oleo_constant_speed_points = 101;
const R oleo_constant_speed_start_speed = K(1.0);
const int oleo_constant_speed_jacobian_column[15] = {
    0, 1, 7, 9, 12, 13, 16, 19, 23, 28, 32, 36, 38, 43, 46
};
const int oleo_constant_speed_jacobian_row[46] = {
    1, 0, 1, 5, 8, 9, 10, 1, 3, 1, 2, 3, 5, 4, 5, 8, 5, 7, 9, 5, 6, 7, 10, 1, 5, 8, 9, 10, 6, 8, 9, 10, 7, 8, 9, 10,
    9, 12, 9, 10, 11, 12, 13, 10, 12, 13
};
