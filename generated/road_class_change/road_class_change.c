#include "road_class_change_real.h"

const char *const road_class_change_model = "Quarter car where the road changes from class B to class D";
const char *const road_class_change_state_names[6] = {
    "z_s",
    "z_u",
    "v_s",
    "v_u",
    "h.height",
    "h.slope"
};
const char *const road_class_change_parameter_names[13] = {
    "m_s",
    "m_u",
    "k_s",
    "c_b",
    "c_r",
    "k_t",
    "G_1",
    "G_2",
    "s_1",
    "s_2",
    "b",
    "H",
    "V"
};
const char *const road_class_change_output_names[4] = {
    "stroke",
    "tyre_deflection",
    "body_acceleration",
    "road"
};
const R road_class_change_default_parameters[13] = {
    K(240.0), K(36.0), K(16000.0), K(600.0), K(1500.0), K(160000.0), K(6.4e-05), K(0.001024), K(60.0), K(100.0),
    K(1.0), K(0.05), K(20.0)
};
const R road_class_change_duration = K(8.0);
const int road_class_change_points = 161;
const R road_class_change_start_speed = K(20.0);
const int road_class_change_jacobian_column[28] = {
    0, 2, 4, 18, 32, 34, 36, 38, 42, 47, 52, 56, 60, 62, 67, 72, 76, 80, 93, 106, 111, 115, 128, 133, 137, 139, 143,
    145
};
const int road_class_change_jacobian_row[145] = {
    2, 3, 2, 3, 0, 2, 3, 8, 9, 13, 14, 17, 18, 19, 20, 21, 22, 23, 1, 2, 3, 8, 9, 13, 14, 17, 18, 19, 20, 21, 22,
    23, 3, 5, 4, 5, 8, 9, 8, 9, 13, 14, 6, 8, 9, 17, 18, 7, 8, 9, 18, 21, 9, 11, 19, 22, 10, 11, 20, 23, 13, 14, 7,
    13, 14, 17, 18, 12, 13, 14, 18, 21, 14, 16, 19, 22, 15, 16, 20, 23, 2, 3, 8, 9, 13, 14, 17, 18, 19, 20, 21, 22,
    23, 2, 3, 8, 9, 13, 14, 17, 18, 19, 20, 21, 22, 23, 10, 18, 19, 20, 22, 11, 19, 20, 23, 2, 3, 8, 9, 13, 14, 17,
    18, 19, 20, 21, 22, 23, 15, 19, 21, 22, 23, 16, 20, 22, 23, 22, 25, 23, 24, 25, 26, 25, 26
};
