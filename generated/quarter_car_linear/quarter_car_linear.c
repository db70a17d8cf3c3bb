#include "quarter_car_linear_real.h"

const char *const quarter_car_linear_model = "Linear quarter car on an ISO 8608 road";
const char *const quarter_car_linear_state_names[5] = {
    "d",
    "e",
    "v_s",
    "v_u",
    "h.height"
};
const char *const quarter_car_linear_parameter_names[7] = {
    "m_s",
    "m_u",
    "k_s",
    "c_s",
    "k_t",
    "G_d",
    "V"
};
const char *const quarter_car_linear_output_names[4] = {
    "stroke",
    "tyre_deflection",
    "body_acceleration",
    "dynamic_tyre_force"
};
const R quarter_car_linear_default_parameters[7] = {
    K(240.0), K(36.0), K(16000.0), K(980.0), K(160000.0), K(0.000256), K(20.0)
};
const R quarter_car_linear_duration = K(5.0);
const int quarter_car_linear_points = 101;
const R quarter_car_linear_start_speed = K(20.0);
const int quarter_car_linear_jacobian_column[21] = {
    0, 2, 3, 6, 10, 10, 12, 15, 20, 26, 28, 29, 33, 38, 39, 42, 48, 51, 55, 59, 59
};
const int quarter_car_linear_jacobian_row[59] = {
    2, 3, 3, 0, 2, 3, 0, 1, 2, 3, 7, 8, 8, 11, 12, 5, 7, 8, 14, 15, 5, 6, 7, 8, 15, 17, 16, 18, 12, 6, 11, 12, 15,
    6, 10, 11, 12, 17, 18, 7, 14, 15, 7, 8, 11, 14, 15, 17, 9, 16, 18, 8, 12, 15, 17, 9, 13, 16, 18
};
