#include "stop_and_go_real.h"

const char *const stop_and_go_model = "Quarter car in stop-and-go traffic";
const char *const stop_and_go_state_names[6] = {
    "z_s",
    "z_u",
    "v_s",
    "v_u",
    "h.height",
    "h.slope"
};
const char *const stop_and_go_parameter_names[9] = {
    "m_s",
    "m_u",
    "k_s",
    "c_s",
    "v_0",
    "share",
    "k_t",
    "G_d",
    "V"
};
const char *const stop_and_go_output_names[4] = {
    "stroke",
    "tyre_deflection",
    "body_acceleration",
    "road"
};
const R stop_and_go_default_parameters[9] = {
    K(240.0), K(36.0), K(16000.0), K(1500.0), K(0.15), K(0.3), K(160000.0), K(0.001024), K(12.0)
};
const R stop_and_go_duration = K(13.0);
const int stop_and_go_points = 131;
const R stop_and_go_start_speed = K(0.0);
const int stop_and_go_jacobian_column[28] = {
    0, 2, 4, 18, 32, 34, 36, 38, 42, 47, 52, 56, 60, 62, 67, 72, 76, 80, 93, 106, 111, 115, 128, 133, 137, 139, 143,
    145
};
const int stop_and_go_jacobian_row[145] = {
    2, 3, 2, 3, 0, 2, 3, 8, 9, 13, 14, 17, 18, 19, 20, 21, 22, 23, 1, 2, 3, 8, 9, 13, 14, 17, 18, 19, 20, 21, 22,
    23, 3, 5, 4, 5, 8, 9, 8, 9, 13, 14, 6, 8, 9, 17, 18, 7, 8, 9, 18, 21, 9, 11, 19, 22, 10, 11, 20, 23, 13, 14, 7,
    13, 14, 17, 18, 12, 13, 14, 18, 21, 14, 16, 19, 22, 15, 16, 20, 23, 2, 3, 8, 9, 13, 14, 17, 18, 19, 20, 21, 22,
    23, 2, 3, 8, 9, 13, 14, 17, 18, 19, 20, 21, 22, 23, 10, 18, 19, 20, 22, 11, 19, 20, 23, 2, 3, 8, 9, 13, 14, 17,
    18, 19, 20, 21, 22, 23, 15, 19, 21, 22, 23, 16, 20, 22, 23, 22, 25, 23, 24, 25, 26, 25, 26
};
