#include "van_der_pol_real.h"

const char *const van_der_pol_model = "Van der Pol oscillator under white noise";
const char *const van_der_pol_state_names[2] = {
    "x",
    "v"
};
const char *const van_der_pol_parameter_names[2] = {
    "mu",
    "Q"
};
const char *const van_der_pol_output_names[1] = {
    "displacement"
};
const R van_der_pol_default_parameters[2] = {
    K(0.5), K(0.3)
};
const R van_der_pol_duration = K(100.0);
const int van_der_pol_points = 201;
const R van_der_pol_start_speed = K(0.0);
const int van_der_pol_jacobian_column[6] = {
    0, 3, 7, 10, 14, 16
};
const int van_der_pol_jacobian_row[16] = {
    1, 3, 4, 0, 1, 3, 4, 1, 3, 4, 1, 2, 3, 4, 3, 4
};
