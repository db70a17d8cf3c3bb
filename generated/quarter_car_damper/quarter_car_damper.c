#include "quarter_car_damper_real.h"

const char *const quarter_car_damper_model = "Quarter car with an asymmetric, digressive damper";
const char *const quarter_car_damper_state_names[5] = {
    "d",
    "e",
    "v_s",
    "v_u",
    "h.height"
};
const char *const quarter_car_damper_parameter_names[10] = {
    "m_s",
    "m_u",
    "k_s",
    "c_s",
    "a",
    "v_b",
    "q",
    "k_t",
    "G_d",
    "V"
};
const char *const quarter_car_damper_output_names[4] = {
    "stroke",
    "tyre_deflection",
    "body_acceleration",
    "damper_force"
};
const R quarter_car_damper_default_parameters[10] = {
    K(240.0), K(36.0), K(16000.0), K(980.0), K(0.4), K(0.3), K(0.4), K(160000.0), K(0.000256), K(20.0)
};
const R quarter_car_damper_duration = K(5.0);
const int quarter_car_damper_points = 101;
const R quarter_car_damper_start_speed = K(20.0);
const int quarter_car_damper_jacobian_column[21] = {
    0, 2, 3, 15, 28, 28, 30, 33, 38, 44, 46, 47, 51, 56, 57, 68, 79, 82, 93, 97, 97
};
const int quarter_car_damper_jacobian_row[97] = {
    2, 3, 3, 0, 2, 3, 7, 8, 11, 12, 14, 15, 16, 17, 18, 0, 1, 2, 3, 7, 8, 11, 12, 14, 15, 16, 17, 18, 7, 8, 8, 11,
    12, 5, 7, 8, 14, 15, 5, 6, 7, 8, 15, 17, 16, 18, 12, 6, 11, 12, 15, 6, 10, 11, 12, 17, 18, 2, 3, 7, 8, 11, 12,
    14, 15, 16, 17, 18, 2, 3, 7, 8, 11, 12, 14, 15, 16, 17, 18, 9, 16, 18, 2, 3, 7, 8, 11, 12, 14, 15, 16, 17, 18,
    9, 13, 16, 18
};
