#include "half_car_acceleration_real.h"

static const int rate_c0[20] = {
    6, 7, 2, 3, 6, 7, 2, 3, 8, 4, 0, 6, 5, 1, 10, 4, 0, 7, 5, 1
};
static const int rate_c1[20] = {
    6, 6, 4, 5, 6, 6, 4, 5, 11, 6, 4, 6, 6, 4, 11, 6, 5, 6, 6, 5
};
static const int rate_c2[12] = {
    0, 1, 2, 3, 8, 9, 10, 11, 14, 15, 16, 17
};
static const int rate_c3[12] = {
    0, 0, 0, 0, 9, 9, 9, 9, 10, 10, 10, 10
};
static const int rate_c4[24] = {
    6, 6, 4, 5, 6, 6, 4, 5, 4, 5, 6, 6, 4, 4, 5, 5, 6, 6, 6, 6, 4, 6, 5, 6
};
static const int rate_c5[24] = {
    2, 3, 2, 3, 2, 3, 2, 3, 2, 3, 2, 3, 2, 2, 3, 3, 2, 3, 2, 3, 2, 2, 3, 3
};
static const int rate_c6[24] = {
    0, 0, 0, 0, 1, 1, 1, 1, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 9, 9, 10, 10
};
static const int rate_c7[32] = {
    4, 5, 6, 6, 4, 5, 4, 11, 5, 11, 4, 4, 5, 5, 6, 6, 4, 5, 6, 6, 4, 4, 11, 6, 6, 11, 5, 5, 11, 6, 6, 11
};
static const int rate_c8[32] = {
    0, 0, 1, 1, 1, 1, 9, 9, 10, 10, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 9, 9, 9, 9, 9, 9, 10, 10, 10, 10, 10, 10
};
static const int rate_c9[72] = {
    66, 69, 76, 81, 82, 87, 66, 69, 76, 81, 82, 87, 66, 69, 76, 81, 82, 87, 66, 69, 76, 81, 82, 87, 66, 69, 66, 69,
    76, 81, 66, 69, 82, 87, 66, 69, 66, 69, 66, 69, 66, 69, 66, 69, 76, 81, 82, 87, 76, 81, 82, 87, 76, 81, 76, 81,
    76, 81, 76, 81, 76, 81, 82, 87, 82, 87, 82, 87, 82, 87, 82, 87
};
static const int rate_c10[72] = {
    14, 15, 12, 20, 12, 22, 25, 26, 13, 31, 13, 33, 35, 36, 14, 41, 14, 43, 36, 45, 15, 50, 15, 52, 37, 46, 38, 47,
    16, 58, 39, 48, 16, 60, 40, 49, 41, 50, 42, 51, 43, 52, 44, 53, 17, 65, 17, 67, 18, 71, 18, 73, 19, 76, 20, 80,
    21, 81, 22, 82, 23, 83, 19, 78, 20, 82, 21, 85, 22, 87, 23, 88
};
static const int rate_c11[36] = {
    88, 89, 90, 88, 89, 90, 88, 89, 90, 88, 89, 90, 88, 88, 89, 88, 90, 88, 88, 88, 88, 88, 89, 90, 89, 90, 89, 89,
    89, 89, 89, 90, 90, 90, 90, 90
};
static const int rate_c12[36] = {
    12, 14, 15, 13, 25, 26, 14, 35, 36, 15, 36, 45, 16, 17, 37, 18, 46, 19, 20, 21, 22, 23, 38, 47, 39, 48, 40, 41,
    42, 43, 44, 49, 50, 51, 52, 53
};
static const int rate_c13[24] = {
    91, 92, 91, 92, 91, 92, 91, 92, 91, 92, 91, 91, 91, 91, 91, 91, 91, 92, 92, 92, 92, 92, 92, 92
};
static const int rate_c14[24] = {
    13, 12, 24, 13, 25, 14, 26, 15, 27, 16, 28, 29, 30, 31, 32, 33, 34, 17, 18, 19, 20, 21, 22, 23
};
static const int rate_c15[12] = {
    167, 170, 173, 176, 179, 180, 182, 184, 185, 186, 187, 188
};
static const int rate_c16[12] = {
    0, 2, 4, 6, 8, 10, 11, 12, 13, 14, 15, 16
};
static const int rate_c17[12] = {
    95, 101, 107, 113, 119, 121, 125, 129, 131, 133, 135, 137
};
static const int rate_c18[12] = {
    96, 102, 108, 114, 120, 122, 126, 130, 132, 134, 136, 138
};
static const int rate_c19[18] = {
    93, 94, 93, 94, 93, 94, 93, 94, 93, 94, 93, 94, 93, 93, 93, 94, 94, 94
};
static const int rate_c20[12] = {
    16, 27, 37, 46, 54, 55, 56, 57, 58, 59, 60, 61
};
static const int rate_c21[24] = {
    24, 25, 24, 25, 24, 25, 24, 25, 24, 25, 24, 24, 24, 24, 24, 24, 24, 25, 25, 25, 25, 25, 25, 25
};
static const int rate_c22[24] = {
    17, 16, 28, 27, 38, 37, 47, 46, 55, 54, 62, 63, 64, 65, 66, 67, 68, 55, 56, 57, 58, 59, 60, 61
};
static const int rate_c23[12] = {
    245, 247, 249, 251, 253, 255, 256, 257, 258, 259, 260, 261
};
static const int rate_c24[72] = {
    26, 27, 28, 29, 30, 31, 26, 27, 28, 29, 30, 31, 26, 27, 28, 29, 30, 31, 26, 27, 28, 29, 30, 31, 26, 27, 26, 27,
    28, 29, 26, 27, 30, 31, 26, 27, 26, 27, 26, 27, 26, 27, 26, 27, 28, 29, 30, 31, 28, 29, 30, 31, 28, 29, 28, 29,
    28, 29, 28, 29, 28, 29, 30, 31, 30, 31, 30, 31, 30, 31, 30, 31
};
static const int rate_c25[72] = {
    18, 19, 16, 18, 16, 19, 29, 30, 27, 29, 27, 30, 39, 40, 37, 39, 37, 40, 48, 49, 46, 48, 46, 49, 56, 57, 63, 64,
    54, 56, 69, 70, 54, 57, 70, 75, 71, 76, 72, 77, 73, 78, 74, 79, 55, 63, 55, 64, 56, 69, 56, 70, 57, 70, 58, 71,
    59, 72, 60, 73, 61, 74, 57, 75, 58, 76, 59, 77, 60, 78, 61, 79
};
static const int rate_c26[12] = {
    269, 275, 281, 287, 293, 295, 299, 303, 305, 307, 309, 311
};
static const int rate_c27[12] = {
    270, 276, 282, 288, 294, 296, 300, 304, 306, 308, 310, 312
};
static const int rate_c28[48] = {
    44, 47, 52, 54, 44, 47, 52, 54, 44, 47, 52, 54, 44, 47, 52, 54, 44, 47, 52, 54, 44, 47, 52, 44, 47, 54, 44, 47,
    44, 47, 44, 47, 44, 47, 44, 47, 52, 54, 52, 52, 52, 52, 52, 54, 54, 54, 54, 54
};
static const int rate_c29[48] = {
    14, 15, 13, 13, 25, 26, 24, 24, 35, 36, 25, 25, 36, 45, 26, 26, 37, 46, 27, 27, 38, 47, 28, 39, 48, 28, 40, 49,
    41, 50, 42, 51, 43, 52, 44, 53, 29, 29, 30, 31, 32, 33, 34, 30, 31, 32, 33, 34
};
static const int rate_c30[48] = {
    93, 94, 203, 204, 93, 94, 203, 204, 93, 94, 203, 204, 93, 94, 203, 204, 93, 94, 203, 204, 93, 94, 203, 93, 94,
    204, 93, 94, 93, 94, 93, 94, 93, 94, 93, 94, 203, 204, 203, 203, 203, 203, 203, 204, 204, 204, 204, 204
};
static const int rate_c31[48] = {
    18, 19, 17, 17, 29, 30, 28, 28, 39, 40, 38, 38, 48, 49, 47, 47, 56, 57, 55, 55, 63, 64, 62, 69, 70, 62, 70, 75,
    71, 76, 72, 77, 73, 78, 74, 79, 63, 63, 64, 65, 66, 67, 68, 64, 65, 66, 67, 68
};
static const int rate_c32[12] = {
    13, 24, 25, 26, 27, 28, 29, 30, 31, 32, 33, 34
};
static const int rate_c33[12] = {
    1, 3, 5, 7, 9, 17, 18, 19, 20, 21, 22, 23
};
static const int rate_c34[12] = {
    341, 345, 349, 353, 357, 361, 364, 367, 369, 371, 373, 375
};
static const int rate_c35[12] = {
    342, 346, 350, 354, 358, 362, 365, 368, 370, 372, 374, 376
};
static const int rate_c36[12] = {
    246, 248, 250, 252, 254, 262, 263, 264, 265, 266, 267, 268
};
static const int rate_c37[12] = {
    17, 28, 38, 47, 55, 62, 63, 64, 65, 66, 67, 68
};
static const int rate_c38[12] = {
    389, 393, 397, 401, 405, 409, 412, 415, 417, 419, 421, 423
};
static const int rate_c39[12] = {
    390, 394, 398, 402, 406, 410, 413, 416, 418, 420, 422, 424
};
static const int rate_c40[24] = {
    97, 99, 103, 105, 109, 111, 115, 117, 123, 127, 139, 141, 143, 145, 147, 149, 151, 153, 155, 157, 159, 161, 163,
    165
};
static const int rate_c41[24] = {
    343, 344, 347, 348, 351, 352, 355, 356, 359, 360, 363, 366, 377, 378, 379, 380, 381, 382, 383, 384, 385, 386,
    387, 388
};
static const int rate_c42[24] = {
    168, 169, 171, 172, 174, 175, 177, 178, 181, 183, 189, 190, 191, 192, 193, 194, 195, 196, 197, 198, 199, 200,
    201, 202
};
static const int rate_c43[24] = {
    271, 273, 277, 279, 283, 285, 289, 291, 297, 301, 313, 315, 317, 319, 321, 323, 325, 327, 329, 331, 333, 335,
    337, 339
};
static const int rate_c44[24] = {
    391, 392, 395, 396, 399, 400, 403, 404, 407, 408, 411, 414, 425, 426, 427, 428, 429, 430, 431, 432, 433, 434,
    435, 436
};
static const int rate_c45[24] = {
    272, 274, 278, 280, 284, 286, 290, 292, 298, 302, 314, 316, 318, 320, 322, 324, 326, 328, 330, 332, 334, 336,
    338, 340
};
static const int rate_c46[24] = {
    98, 100, 104, 106, 110, 112, 116, 118, 124, 128, 140, 142, 144, 146, 148, 150, 152, 154, 156, 158, 160, 162,
    164, 166
};
static const int rate_c47[24] = {
    21, 23, 32, 34, 42, 44, 51, 53, 59, 61, 66, 68, 72, 74, 77, 79, 81, 84, 83, 85, 86, 86, 88, 89
};
static const int rate_c48[48] = {
    95, 96, 97, 98, 95, 96, 97, 98, 95, 96, 97, 98, 95, 96, 97, 98, 95, 96, 97, 98, 95, 96, 97, 98, 95, 96, 97, 98,
    95, 96, 97, 98, 95, 96, 97, 98, 95, 96, 95, 96, 97, 98, 95, 96, 97, 98, 97, 98
};
static const int rate_c49[48] = {
    20, 21, 22, 23, 31, 32, 33, 34, 41, 42, 43, 44, 50, 51, 52, 53, 58, 59, 60, 61, 65, 66, 67, 68, 71, 72, 73, 74,
    76, 77, 78, 79, 80, 81, 82, 83, 81, 84, 82, 85, 85, 86, 83, 86, 87, 88, 88, 89
};


void half_car_acceleration_rate_parts(R t, const R *restrict y, const R *restrict p, R *restrict dy, R *restrict parts)
{
    R w[437];
    dy[0] = y[4];
    dy[1] = y[5];
    dy[2] = y[6];
    dy[3] = y[7];
    for (int k = 0; k < 20; k++) {
        w[k] = y[rate_c0[k]] * p[rate_c1[k]];
    }
    for (int k = 0; k < 12; k++) {
        w[20 + k] = w[rate_c2[k]] / p[rate_c3[k]];
    }
    for (int k = 0; k < 24; k++) {
        const R a6 = p[rate_c4[k]] * p[rate_c5[k]];
        w[32 + k] = a6 / p[rate_c6[k]];
    }
    const R a10 = w[32] + w[33];
    const R a11 = y[5] * a10;
    const R a16 = w[34] + w[35];
    const R a17 = y[1] * a16;
    const R a18 = a11 + a17;
    for (int k = 0; k < 32; k++) {
        w[56 + k] = p[rate_c7[k]] / p[rate_c8[k]];
    }
    const R a21 = w[56] + w[57];
    const R a22 = y[0] * a21;
    const R a23 = a18 + a22;
    const R a24 = w[20] - a23;
    const R a27 = a24 + w[21];
    const R a30 = a27 + w[22];
    const R a33 = a30 + w[23];
    const R a34 = p[2] * y[5];
    const R a35 = y[4] + a34;
    const R a36 = a35 - y[6];
    const R a37 = (R)(K(0.0) <= a36);
    const R a38 = a36 * a36;
    const R a39 = p[2] * y[55];
    const R a40 = y[54] + a39;
    const R a41 = a40 - y[56];
    const R a42 = p[2] * y[55];
    const R a43 = a41 + a42;
    const R a44 = p[2] * p[2];
    const R a45 = a44 * y[62];
    const R a46 = a43 + a45;
    const R a47 = p[2] * y[63];
    const R a48 = a46 - a47;
    const R a49 = a48 - y[56];
    const R a50 = p[2] * y[63];
    const R a51 = a49 - a50;
    const R a52 = a51 + y[69];
    const R a53 = (R)(K(0.0) <= a52);
    const R a54 = a53 != K(0.0) ? a52 : K(0.0);
    const R a55 = a38 + a54;
    const R a56 = a37 != K(0.0) ? a55 : K(0.0);
    const R a57 = (R)(K(0.0) <= a36);
    const R a58 = (R)(a57 == K(0.0));
    const R a59 = a36 * a36;
    const R a60 = a53 != K(0.0) ? a52 : K(0.0);
    const R a61 = a59 + a60;
    const R a62 = p[8] * a61;
    const R a63 = -a62;
    const R a64 = a58 != K(0.0) ? a63 : K(0.0);
    const R a65 = a56 + a64;
    const R a66 = K(1.0) + p[8];
    const R a67 = a53 != K(0.0) ? a52 : K(0.0);
    const R a68 = a67 + TINY(1e-100);
    const R a69 = M(sqrt)(a68);
    const R a70 = a36 / a69;
    const R a71 = (R)(K(39.0) < a70);
    const R a72 = a71 != K(0.0) ? K(39.0) : K(0.0);
    const R a73 = (R)(a71 == K(0.0));
    const R a74 = (R)(a70 < K(-39.0));
    const R a75 = a74 != K(0.0) ? K(-39.0) : K(0.0);
    const R a76 = (R)(a74 == K(0.0));
    const R a77 = a76 != K(0.0) ? a70 : K(0.0);
    const R a78 = a75 + a77;
    const R a79 = a73 != K(0.0) ? a78 : K(0.0);
    const R a80 = a72 + a79;
    const R a81 = (R)(K(0.0) <= a80);
    const R a82 = (R)(K(0.0) <= a80);
    const R a83 = a82 != K(0.0) ? a80 : K(0.0);
    const R a84 = (R)(a82 == K(0.0));
    const R a85 = -a80;
    const R a86 = a84 != K(0.0) ? a85 : K(0.0);
    const R a87 = a83 + a86;
    const R a88 = K(5.0) + a87;
    const R a89 = K(5.0) / a88;
    const R a90 = a89 + a89;
    const R a91 = a90 - K(1.0);
    const R a92 = a91 * a91;
    const R a93 = a92 * a92;
    const R a94 = K(6.251210894320826e-11) * a93;
    const R a95 = a94 + K(5.634402395088606e-09);
    const R a96 = a95 * a93;
    const R a97 = a96 + K(2.1873267047187882e-07);
    const R a98 = a97 * a93;
    const R a99 = a98 + K(8.362917173264925e-06);
    const R a100 = a99 * a93;
    const R a101 = a100 + K(-0.00039999239499687316);
    const R a102 = a101 * a93;
    const R a103 = a102 + K(0.08272894314653675);
    const R a104 = a103 * a93;
    const R a105 = a104 + K(0.3856162094306315);
    const R a106 = K(-6.373733687733026e-10) * a93;
    const R a107 = a106 + K(-1.933685671443265e-08);
    const R a108 = a107 * a93;
    const R a109 = a108 + K(-1.9949560171085464e-06);
    const R a110 = a109 * a93;
    const R a111 = a110 + K(-0.00027317183218848723);
    const R a112 = a111 * a93;
    const R a113 = a112 + K(0.034650946817430084);
    const R a114 = a113 * a93;
    const R a115 = a114 + K(0.333573319037792);
    const R a116 = a91 * a115;
    const R a117 = a105 + a116;
    const R a118 = K(-7.688368129929841e-10) * a93;
    const R a119 = a118 + K(-3.5282479379543805e-08);
    const R a120 = a119 * a93;
    const R a121 = a120 + K(-1.3890066276983257e-06);
    const R a122 = a121 * a93;
    const R a123 = a122 + K(-2.9766610464679603e-05);
    const R a124 = a123 * a93;
    const R a125 = a124 + K(0.01042510048245576);
    const R a126 = a125 * a93;
    const R a127 = a126 + K(0.2483094123147733);
    const R a128 = K(6.673700975846336e-11) * a93;
    const R a129 = a128 + K(3.479624855535839e-09);
    const R a130 = a129 * a93;
    const R a131 = a130 + K(1.6721351960362814e-07);
    const R a132 = a131 * a93;
    const R a133 = a132 + K(2.494713163744216e-05);
    const R a134 = a133 * a93;
    const R a135 = a134 + K(0.0015006565641357517);
    const R a136 = a135 * a93;
    const R a137 = a136 + K(0.15718221510930905);
    const R a138 = a91 * a137;
    const R a139 = a127 + a138;
    const R a140 = a92 * a139;
    const R a141 = a117 + a140;
    const R a142 = a89 * a141;
    const R a143 = a87 * a142;
    const R a144 = K(1.0) - a143;
    const R a145 = a87 * a144;
    const R a146 = a142 - a145;
    const R a147 = -a146;
    const R a148 = a81 != K(0.0) ? a147 : K(0.0);
    const R a149 = (R)(a81 == K(0.0));
    const R a150 = a149 != K(0.0) ? a146 : K(0.0);
    const R a151 = a148 + a150;
    const R a152 = a66 * a151;
    const R a153 = a152 * a68;
    const R a154 = a36 / a69;
    const R a155 = (R)(K(39.0) < a154);
    const R a156 = a155 != K(0.0) ? K(39.0) : K(0.0);
    const R a157 = (R)(a155 == K(0.0));
    const R a158 = (R)(a154 < K(-39.0));
    const R a159 = a158 != K(0.0) ? K(-39.0) : K(0.0);
    const R a160 = (R)(a158 == K(0.0));
    const R a161 = a160 != K(0.0) ? a154 : K(0.0);
    const R a162 = a159 + a161;
    const R a163 = a157 != K(0.0) ? a162 : K(0.0);
    const R a164 = a156 + a163;
    const R a165 = a164 * a164;
    const R a166 = a165 / K(2.0);
    const R a167 = -a166;
    const R a168 = M(exp)(a167);
    const R a169 = K(0.3989422804014327) * a168;
    const R a170 = a153 * a169;
    const R a171 = a65 + a170;
    const R a172 = a171 * p[7];
    const R a173 = a172 / p[0];
    const R a174 = a33 - a173;
    const R a175 = p[3] * y[5];
    const R a176 = y[4] + a175;
    const R a177 = a176 - y[7];
    const R a178 = (R)(K(0.0) <= a177);
    const R a179 = a177 * a177;
    const R a180 = p[3] * y[55];
    const R a181 = y[54] + a180;
    const R a182 = a181 - y[57];
    const R a183 = p[3] * y[55];
    const R a184 = a182 + a183;
    const R a185 = p[3] * p[3];
    const R a186 = a185 * y[62];
    const R a187 = a184 + a186;
    const R a188 = p[3] * y[64];
    const R a189 = a187 - a188;
    const R a190 = a189 - y[57];
    const R a191 = p[3] * y[64];
    const R a192 = a190 - a191;
    const R a193 = a192 + y[75];
    const R a194 = (R)(K(0.0) <= a193);
    const R a195 = a194 != K(0.0) ? a193 : K(0.0);
    const R a196 = a179 + a195;
    const R a197 = a178 != K(0.0) ? a196 : K(0.0);
    const R a198 = (R)(K(0.0) <= a177);
    const R a199 = (R)(a198 == K(0.0));
    const R a200 = a177 * a177;
    const R a201 = a194 != K(0.0) ? a193 : K(0.0);
    const R a202 = a200 + a201;
    const R a203 = p[8] * a202;
    const R a204 = -a203;
    const R a205 = a199 != K(0.0) ? a204 : K(0.0);
    const R a206 = a197 + a205;
    const R a207 = K(1.0) + p[8];
    const R a208 = a194 != K(0.0) ? a193 : K(0.0);
    const R a209 = a208 + TINY(1e-100);
    const R a210 = M(sqrt)(a209);
    const R a211 = a177 / a210;
    const R a212 = (R)(K(39.0) < a211);
    const R a213 = a212 != K(0.0) ? K(39.0) : K(0.0);
    const R a214 = (R)(a212 == K(0.0));
    const R a215 = (R)(a211 < K(-39.0));
    const R a216 = a215 != K(0.0) ? K(-39.0) : K(0.0);
    const R a217 = (R)(a215 == K(0.0));
    const R a218 = a217 != K(0.0) ? a211 : K(0.0);
    const R a219 = a216 + a218;
    const R a220 = a214 != K(0.0) ? a219 : K(0.0);
    const R a221 = a213 + a220;
    const R a222 = (R)(K(0.0) <= a221);
    const R a223 = (R)(K(0.0) <= a221);
    const R a224 = a223 != K(0.0) ? a221 : K(0.0);
    const R a225 = (R)(a223 == K(0.0));
    const R a226 = -a221;
    const R a227 = a225 != K(0.0) ? a226 : K(0.0);
    const R a228 = a224 + a227;
    const R a229 = K(5.0) + a228;
    const R a230 = K(5.0) / a229;
    const R a231 = a230 + a230;
    const R a232 = a231 - K(1.0);
    const R a233 = a232 * a232;
    const R a234 = a233 * a233;
    const R a235 = K(6.251210894320826e-11) * a234;
    const R a236 = a235 + K(5.634402395088606e-09);
    const R a237 = a236 * a234;
    const R a238 = a237 + K(2.1873267047187882e-07);
    const R a239 = a238 * a234;
    const R a240 = a239 + K(8.362917173264925e-06);
    const R a241 = a240 * a234;
    const R a242 = a241 + K(-0.00039999239499687316);
    const R a243 = a242 * a234;
    const R a244 = a243 + K(0.08272894314653675);
    const R a245 = a244 * a234;
    const R a246 = a245 + K(0.3856162094306315);
    const R a247 = K(-6.373733687733026e-10) * a234;
    const R a248 = a247 + K(-1.933685671443265e-08);
    const R a249 = a248 * a234;
    const R a250 = a249 + K(-1.9949560171085464e-06);
    const R a251 = a250 * a234;
    const R a252 = a251 + K(-0.00027317183218848723);
    const R a253 = a252 * a234;
    const R a254 = a253 + K(0.034650946817430084);
    const R a255 = a254 * a234;
    const R a256 = a255 + K(0.333573319037792);
    const R a257 = a232 * a256;
    const R a258 = a246 + a257;
    const R a259 = K(-7.688368129929841e-10) * a234;
    const R a260 = a259 + K(-3.5282479379543805e-08);
    const R a261 = a260 * a234;
    const R a262 = a261 + K(-1.3890066276983257e-06);
    const R a263 = a262 * a234;
    const R a264 = a263 + K(-2.9766610464679603e-05);
    const R a265 = a264 * a234;
    const R a266 = a265 + K(0.01042510048245576);
    const R a267 = a266 * a234;
    const R a268 = a267 + K(0.2483094123147733);
    const R a269 = K(6.673700975846336e-11) * a234;
    const R a270 = a269 + K(3.479624855535839e-09);
    const R a271 = a270 * a234;
    const R a272 = a271 + K(1.6721351960362814e-07);
    const R a273 = a272 * a234;
    const R a274 = a273 + K(2.494713163744216e-05);
    const R a275 = a274 * a234;
    const R a276 = a275 + K(0.0015006565641357517);
    const R a277 = a276 * a234;
    const R a278 = a277 + K(0.15718221510930905);
    const R a279 = a232 * a278;
    const R a280 = a268 + a279;
    const R a281 = a233 * a280;
    const R a282 = a258 + a281;
    const R a283 = a230 * a282;
    const R a284 = a228 * a283;
    const R a285 = K(1.0) - a284;
    const R a286 = a228 * a285;
    const R a287 = a283 - a286;
    const R a288 = -a287;
    const R a289 = a222 != K(0.0) ? a288 : K(0.0);
    const R a290 = (R)(a222 == K(0.0));
    const R a291 = a290 != K(0.0) ? a287 : K(0.0);
    const R a292 = a289 + a291;
    const R a293 = a207 * a292;
    const R a294 = a293 * a209;
    const R a295 = a177 / a210;
    const R a296 = (R)(K(39.0) < a295);
    const R a297 = a296 != K(0.0) ? K(39.0) : K(0.0);
    const R a298 = (R)(a296 == K(0.0));
    const R a299 = (R)(a295 < K(-39.0));
    const R a300 = a299 != K(0.0) ? K(-39.0) : K(0.0);
    const R a301 = (R)(a299 == K(0.0));
    const R a302 = a301 != K(0.0) ? a295 : K(0.0);
    const R a303 = a300 + a302;
    const R a304 = a298 != K(0.0) ? a303 : K(0.0);
    const R a305 = a297 + a304;
    const R a306 = a305 * a305;
    const R a307 = a306 / K(2.0);
    const R a308 = -a307;
    const R a309 = M(exp)(a308);
    const R a310 = K(0.3989422804014327) * a309;
    const R a311 = a294 * a310;
    const R a312 = a206 + a311;
    const R a313 = a312 * p[7];
    const R a314 = a313 / p[0];
    const R a315 = a174 - a314;
    const R a316 = K(-2.0) * y[4];
    const R a317 = a316 * p[6];
    const R a318 = a317 / p[0];
    const R a319 = a315 + a318;
    dy[4] = a319;
    const R a322 = w[4] * p[2];
    const R a323 = a322 / p[1];
    const R a325 = p[2] * p[2];
    const R a326 = w[58] * a325;
    const R a328 = p[3] * p[3];
    const R a329 = w[59] * a328;
    const R a330 = a326 + a329;
    const R a331 = y[5] * a330;
    const R a333 = w[60] * a325;
    const R a335 = w[61] * a328;
    const R a336 = a333 + a335;
    const R a337 = y[1] * a336;
    const R a338 = a331 + a337;
    const R a343 = w[36] + w[37];
    const R a344 = y[4] * a343;
    const R a345 = a338 + a344;
    const R a350 = w[38] + w[39];
    const R a351 = y[0] * a350;
    const R a352 = a345 + a351;
    const R a353 = a323 - a352;
    const R a355 = w[5] * p[3];
    const R a356 = a355 / p[1];
    const R a357 = a353 + a356;
    const R a359 = w[6] * p[2];
    const R a360 = a359 / p[1];
    const R a361 = a357 + a360;
    const R a363 = w[7] * p[3];
    const R a364 = a363 / p[1];
    const R a365 = a361 + a364;
    const R a366 = a171 * p[7];
    const R a367 = a366 * p[2];
    const R a368 = a367 / p[1];
    const R a369 = a365 - a368;
    const R a370 = a312 * p[7];
    const R a371 = a370 * p[3];
    const R a372 = a371 / p[1];
    const R a373 = a369 - a372;
    dy[5] = a373;
    const R a379 = w[62] + w[63];
    const R a380 = y[2] * a379;
    const R a381 = w[24] - a380;
    const R a384 = a381 + w[25];
    const R a387 = a384 + w[26];
    const R a388 = a171 * p[7];
    const R a389 = a388 / p[9];
    const R a390 = a387 + a389;
    const R a393 = a390 - w[27];
    const R a395 = w[12] * p[2];
    const R a396 = a395 / p[9];
    const R a397 = a393 + a396;
    const R a399 = w[13] * p[2];
    const R a400 = a399 / p[9];
    const R a401 = a397 + a400;
    dy[6] = a401;
    const R a407 = w[64] + w[65];
    const R a408 = y[3] * a407;
    const R a409 = w[28] - a408;
    const R a412 = a409 + w[29];
    const R a415 = a412 + w[30];
    const R a416 = a312 * p[7];
    const R a417 = a416 / p[10];
    const R a418 = a415 + a417;
    const R a421 = a418 - w[31];
    const R a423 = w[18] * p[3];
    const R a424 = a423 / p[10];
    const R a425 = a421 + a424;
    const R a427 = w[19] * p[3];
    const R a428 = a427 / p[10];
    const R a429 = a425 + a428;
    dy[7] = a429;
    const R a431 = p[13] * t;
    const R a432 = y[9] * a431;
    dy[8] = a432;
    const R a440 = y[11] * a431;
    dy[10] = a440;
    const R a434 = K(-8.1) * y[9];
    const R a435 = a434 * a431;
    const R a436 = K(-0.8) * y[8];
    const R a437 = a436 * a431;
    const R a438 = a435 + a437;
    dy[9] = a438;
    const R a442 = K(-8.1) * y[11];
    const R a443 = a442 * a431;
    const R a444 = K(-0.8) * y[10];
    const R a445 = a444 * a431;
    const R a446 = a443 + a445;
    dy[11] = a446;
    const R a448 = y[16] + y[16];
    dy[12] = a448;
    const R a712 = y[28] + y[28];
    dy[24] = a712;
    const R a802 = y[39] + y[39];
    dy[35] = a802;
    const R a890 = y[49] + y[49];
    dy[45] = a890;
    const R a450 = y[17] + y[27];
    dy[13] = a450;
    const R a452 = y[18] + y[37];
    dy[14] = a452;
    const R a454 = y[19] + y[46];
    dy[15] = a454;
    const R a714 = y[29] + y[38];
    dy[25] = a714;
    const R a716 = y[30] + y[47];
    dy[26] = a716;
    const R a804 = y[40] + y[48];
    dy[36] = a804;
    const R a460 = w[67] + w[68];
    w[88] = a460;
    const R a623 = w[77] + w[78];
    w[89] = a623;
    const R a659 = w[83] + w[84];
    w[90] = a659;
    const R a466 = w[40] + w[41];
    w[91] = a466;
    const R a549 = w[45] + w[46];
    w[92] = a549;
    const R a473 = K(-2.0) * p[6];
    const R a474 = a473 / p[0];
    const R a475 = (R)(K(0.0) <= a36);
    const R a476 = a36 + a36;
    const R a477 = a475 != K(0.0) ? a476 : K(0.0);
    const R a478 = (R)(K(0.0) <= a36);
    const R a479 = (R)(a478 == K(0.0));
    const R a480 = K(-2.0) * p[8];
    const R a481 = a480 * a36;
    const R a482 = a479 != K(0.0) ? a481 : K(0.0);
    const R a483 = a477 + a482;
    const R a484 = p[8] + p[8];
    const R a485 = K(2.0) + a484;
    const R a486 = a485 * a144;
    const R a487 = a486 * a69;
    const R a488 = a487 * a169;
    const R a489 = a483 + a488;
    w[93] = a489;
    const R a493 = (R)(K(0.0) <= a177);
    const R a494 = a177 + a177;
    const R a495 = a493 != K(0.0) ? a494 : K(0.0);
    const R a496 = (R)(K(0.0) <= a177);
    const R a497 = (R)(a496 == K(0.0));
    const R a498 = K(-2.0) * p[8];
    const R a499 = a498 * a177;
    const R a500 = a497 != K(0.0) ? a499 : K(0.0);
    const R a501 = a495 + a500;
    const R a502 = p[8] + p[8];
    const R a503 = K(2.0) + a502;
    const R a504 = a503 * a285;
    const R a505 = a504 * a210;
    const R a506 = a505 * a310;
    const R a507 = a501 + a506;
    w[94] = a507;
    for (int k = 0; k < 72; k++) {
        w[95 + k] = w[rate_c9[k]] * y[rate_c10[k]];
    }
    for (int k = 0; k < 36; k++) {
        w[167 + k] = w[rate_c11[k]] * y[rate_c12[k]];
    }
    for (int k = 0; k < 24; k++) {
        w[k] = w[rate_c13[k]] * y[rate_c14[k]];
    }
    for (int k = 0; k < 12; k++) {
        const R a468 = w[rate_c15[k]] + w[rate_c16[k]];
        const R a469 = w[rate_c17[k]] - a468;
        w[203 + k] = a469 + w[rate_c18[k]];
    }
    for (int k = 0; k < 18; k++) {
        w[215 + k] = p[7] * w[rate_c19[k]];
    }
    const R a491 = w[215] / p[0];
    const R a492 = a474 - a491;
    const R a509 = w[216] / p[0];
    const R a510 = a492 - a509;
    const R a517 = w[42] + w[43];
    const R a519 = w[217] * p[2];
    const R a520 = a519 / p[0];
    const R a521 = a517 + a520;
    const R a523 = w[218] * p[3];
    const R a524 = a523 / p[0];
    const R a525 = a521 + a524;
    w[24] = a525;
    const R a569 = w[48] + w[49];
    const R a571 = w[221] * p[2];
    const R a572 = a571 / p[1];
    const R a573 = a569 + a572;
    const R a575 = w[222] * p[3];
    const R a576 = a575 / p[1];
    const R a577 = a573 + a576;
    w[25] = a577;
    const R a530 = w[219] / p[0];
    const R a531 = w[70] + a530;
    w[26] = a531;
    const R a536 = w[220] / p[0];
    const R a537 = w[71] + a536;
    w[27] = a537;
    const R a628 = w[227] / p[9];
    const R a629 = w[79] + a628;
    w[28] = a629;
    const R a642 = w[229] / p[9];
    const R a643 = w[80] + a642;
    w[29] = a643;
    const R a664 = w[230] / p[10];
    const R a665 = w[85] + a664;
    w[30] = a665;
    const R a678 = w[232] / p[10];
    const R a679 = w[86] + a678;
    w[31] = a679;
    for (int k = 0; k < 12; k++) {
        const R a511 = a510 * y[rate_c20[k]];
        w[233 + k] = w[203 + k] + a511;
    }
    for (int k = 0; k < 24; k++) {
        w[245 + k] = w[rate_c21[k]] * y[rate_c22[k]];
    }
    for (int k = 0; k < 12; k++) {
        w[203 + k] = w[233 + k] - w[rate_c23[k]];
    }
    for (int k = 0; k < 72; k++) {
        w[269 + k] = w[rate_c24[k]] * y[rate_c25[k]];
    }
    for (int k = 0; k < 12; k++) {
        const R a533 = w[203 + k] + w[rate_c26[k]];
        w[233 + k] = a533 + w[rate_c27[k]];
    }
    const R a540 = w[233] + y[54];
    dy[16] = a540;
    const R a733 = w[234] + y[55];
    dy[27] = a733;
    const R a821 = w[235] + y[56];
    dy[37] = a821;
    const R a907 = w[236] + y[57];
    dy[46] = a907;
    const R a552 = p[2] * p[2];
    const R a553 = w[72] * a552;
    const R a555 = p[3] * p[3];
    const R a556 = w[73] * a555;
    const R a557 = a553 + a556;
    const R a581 = p[2] * p[2];
    const R a582 = w[74] * a581;
    const R a584 = p[3] * p[3];
    const R a585 = w[75] * a584;
    const R a586 = a582 + a585;
    const R a588 = w[223] / p[1];
    const R a589 = a588 * a581;
    const R a590 = a586 + a589;
    const R a592 = w[224] / p[1];
    const R a593 = a592 * a584;
    const R a594 = a590 + a593;
    const R a600 = w[225] * p[2];
    const R a601 = a600 / p[1];
    const R a602 = w[50] + a601;
    w[93] = a602;
    const R a608 = w[226] * p[3];
    const R a609 = a608 / p[1];
    const R a610 = w[51] + a609;
    w[94] = a610;
    const R a635 = w[228] * p[2];
    const R a636 = a635 / p[9];
    const R a637 = w[53] + a636;
    w[203] = a637;
    const R a671 = w[231] * p[3];
    const R a672 = a671 / p[10];
    const R a673 = w[55] + a672;
    w[204] = a673;
    for (int k = 0; k < 48; k++) {
        w[341 + k] = w[rate_c28[k]] * y[rate_c29[k]];
        w[389 + k] = w[rate_c30[k]] * y[rate_c31[k]];
    }
    for (int k = 0; k < 12; k++) {
        const R a558 = a557 * y[rate_c32[k]];
        const R a559 = w[rate_c33[k]] + a558;
        const R a560 = w[rate_c34[k]] - a559;
        const R a564 = a560 + w[rate_c35[k]];
        const R a579 = a564 - w[rate_c36[k]];
        const R a595 = a594 * y[rate_c37[k]];
        const R a596 = a579 - a595;
        const R a604 = a596 + w[rate_c38[k]];
        w[205 + k] = a604 + w[rate_c39[k]];
    }
    const R a613 = w[205] + y[55];
    dy[17] = a613;
    const R a750 = w[206] + y[62];
    dy[28] = a750;
    const R a838 = w[207] + y[63];
    dy[38] = a838;
    const R a924 = w[208] + y[64];
    dy[47] = a924;
    for (int k = 0; k < 24; k++) {
        const R a620 = w[rate_c40[k]] + w[rate_c41[k]];
        const R a625 = a620 - w[rate_c42[k]];
        const R a631 = a625 + w[rate_c43[k]];
        const R a639 = a631 + w[rate_c44[k]];
        const R a645 = a639 - w[rate_c45[k]];
        w[k] = a645 + w[rate_c46[k]];
        w[245 + k] = a431 * y[rate_c47[k]];
    }
    const R a649 = w[0] + y[56];
    dy[18] = a649;
    const R a685 = w[1] + y[57];
    dy[19] = a685;
    const R a765 = w[2] + y[63];
    dy[29] = a765;
    const R a780 = w[3] + y[64];
    dy[30] = a780;
    const R a853 = w[4] + y[69];
    dy[39] = a853;
    const R a868 = w[5] + y[70];
    dy[40] = a868;
    const R a939 = w[6] + y[70];
    dy[48] = a939;
    const R a954 = w[7] + y[75];
    dy[49] = a954;
    const R a688 = w[245] + y[58];
    dy[20] = a688;
    const R a698 = w[246] + y[60];
    dy[22] = a698;
    const R a783 = w[247] + y[65];
    dy[31] = a783;
    const R a791 = w[248] + y[67];
    dy[33] = a791;
    const R a871 = w[249] + y[71];
    dy[41] = a871;
    const R a879 = w[250] + y[73];
    dy[43] = a879;
    const R a957 = w[251] + y[76];
    dy[50] = a957;
    const R a965 = w[252] + y[78];
    dy[52] = a965;
    const R a690 = K(-0.8) * a431;
    w[95] = a690;
    const R a692 = K(-8.1) * a431;
    w[96] = a692;
    const R a700 = K(-0.8) * a431;
    w[97] = a700;
    const R a702 = K(-8.1) * a431;
    w[98] = a702;
    for (int k = 0; k < 48; k++) {
        w[99 + k] = w[rate_c48[k]] * y[rate_c49[k]];
    }
    for (int k = 0; k < 24; k++) {
        w[147 + k] = w[99 + 2 * k] + w[100 + 2 * k];
    }
    const R a695 = w[147] + y[59];
    dy[21] = a695;
    const R a788 = w[149] + y[66];
    dy[32] = a788;
    const R a876 = w[151] + y[72];
    dy[42] = a876;
    const R a962 = w[153] + y[77];
    dy[51] = a962;
    const R a705 = w[148] + y[61];
    const R a706 = K(0.19739208802178718) * p[12];
    const R a707 = y[722] * a706;
    const R a708 = K(8.0) * a707;
    const R a709 = a431 * a708;
    const R a710 = a705 + a709;
    dy[23] = a710;
    const R a796 = w[150] + y[68];
    const R a797 = y[723] * a706;
    const R a798 = K(8.0) * a797;
    const R a799 = a431 * a798;
    const R a800 = a796 + a799;
    dy[34] = a800;
    const R a884 = w[152] + y[74];
    const R a885 = y[724] * a706;
    const R a886 = K(8.0) * a885;
    const R a887 = a431 * a886;
    const R a888 = a884 + a887;
    dy[44] = a888;
    const R a970 = w[154] + y[79];
    const R a971 = y[725] * a706;
    const R a972 = K(8.0) * a971;
    const R a973 = a431 * a972;
    const R a974 = a970 + a973;
    dy[53] = a974;
    const R a991 = w[237] + w[237];
    dy[54] = a991;
    const R a1023 = w[209] + w[238];
    dy[55] = a1023;
    const R a1053 = w[8] + w[239];
    dy[56] = a1053;
    const R a1083 = w[9] + w[240];
    dy[57] = a1083;
    const R a1101 = w[253] + w[241];
    dy[58] = a1101;
    const R a1139 = w[254] + w[243];
    dy[60] = a1139;
    const R a1121 = w[155] + w[242];
    dy[59] = a1121;
    const R a1159 = w[156] + w[244];
    const R a1160 = y[726] * a706;
    const R a1161 = K(8.0) * a1160;
    const R a1162 = a431 * a1161;
    const R a1163 = a1159 + a1162;
    dy[61] = a1163;
    const R a1180 = w[210] + w[210];
    dy[62] = a1180;
    const R a1210 = w[10] + w[211];
    dy[63] = a1210;
    const R a1240 = w[11] + w[212];
    dy[64] = a1240;
    const R a1258 = w[255] + w[213];
    dy[65] = a1258;
    const R a1296 = w[256] + w[215];
    dy[67] = a1296;
    const R a1278 = w[157] + w[214];
    dy[66] = a1278;
    const R a1316 = w[158] + w[216];
    const R a1317 = y[727] * a706;
    const R a1318 = K(8.0) * a1317;
    const R a1319 = a431 * a1318;
    const R a1320 = a1316 + a1319;
    dy[68] = a1320;
    const R a1335 = w[12] + w[12];
    dy[69] = a1335;
    const R a1450 = w[19] + w[19];
    dy[75] = a1450;
    const R a1363 = w[13] + w[14];
    dy[70] = a1363;
    const R a1379 = w[257] + w[15];
    dy[71] = a1379;
    const R a1413 = w[258] + w[17];
    dy[73] = a1413;
    const R a1466 = w[259] + w[20];
    dy[76] = a1466;
    const R a1500 = w[260] + w[22];
    dy[78] = a1500;
    const R a1397 = w[159] + w[16];
    dy[72] = a1397;
    const R a1484 = w[161] + w[21];
    dy[77] = a1484;
    const R a1431 = w[160] + w[18];
    const R a1432 = y[728] * a706;
    const R a1433 = K(8.0) * a1432;
    const R a1434 = a431 * a1433;
    const R a1435 = a1431 + a1434;
    dy[74] = a1435;
    const R a1518 = w[162] + w[23];
    const R a1519 = y[729] * a706;
    const R a1520 = K(8.0) * a1519;
    const R a1521 = a431 * a1520;
    const R a1522 = a1518 + a1521;
    dy[79] = a1522;
    const R a1525 = w[261] + w[261];
    dy[80] = a1525;
    const R a1575 = w[267] + w[267];
    dy[87] = a1575;
    const R a1531 = w[163] + w[262];
    dy[81] = a1531;
    const R a1581 = w[169] + w[268];
    dy[88] = a1581;
    const R a1535 = w[263] + w[264];
    dy[82] = a1535;
    const R a1541 = w[164] + w[265];
    const R a1542 = y[888] * a706;
    const R a1543 = K(8.0) * a1542;
    const R a1544 = a431 * a1543;
    const R a1545 = a1541 + a1544;
    dy[83] = a1545;
    const R a1550 = w[165] + w[165];
    const R a1551 = K(1.28) * p[12];
    const R a1552 = a1551 * a431;
    const R a1553 = K(9.869604401089358) * a1552;
    const R a1554 = a1550 + a1553;
    dy[84] = a1554;
    const R a1586 = w[170] + w[170];
    const R a1587 = K(1.28) * p[12];
    const R a1588 = a1587 * a431;
    const R a1589 = K(9.869604401089358) * a1588;
    const R a1590 = a1586 + a1589;
    dy[89] = a1590;
    const R a1560 = w[266] + w[166];
    dy[85] = a1560;
    const R a1568 = w[167] + w[168];
    const R a1569 = y[889] * a706;
    const R a1570 = K(8.0) * a1569;
    const R a1571 = a431 * a1570;
    const R a1572 = a1568 + a1571;
    dy[86] = a1572;
    const R a1592 = -a460;
    parts[0] = a1592;
    const R a1606 = -a623;
    parts[10] = a1606;
    const R a1610 = -a659;
    parts[13] = a1610;
    const R a1594 = -a549;
    parts[1] = a1594;
    const R a1598 = -a466;
    parts[4] = a1598;
    parts[2] = w[76];
    parts[3] = w[82];
    parts[8] = w[66];
    parts[11] = w[69];
    parts[32] = w[81];
    parts[36] = w[87];
    const R a1600 = -a557;
    parts[5] = a1600;
    parts[6] = w[52];
    parts[7] = w[54];
    parts[9] = w[44];
    parts[12] = w[47];
    parts[14] = K(1.0);
    parts[19] = K(1.0);
    parts[24] = K(1.0);
    parts[28] = K(1.0);
    parts[15] = a510;
    const R a1614 = -a577;
    parts[16] = a1614;
    const R a1619 = -a525;
    parts[20] = a1619;
    parts[17] = a629;
    parts[18] = a665;
    parts[25] = a531;
    parts[29] = a537;
    const R a1621 = -a594;
    parts[21] = a1621;
    parts[22] = a637;
    parts[23] = a673;
    parts[26] = a602;
    parts[30] = a610;
    const R a1628 = -a643;
    parts[27] = a1628;
    const R a1633 = -a679;
    parts[31] = a1633;
    parts[33] = a690;
    parts[35] = a692;
    parts[37] = a700;
    parts[39] = a702;
    parts[34] = a431;
    parts[38] = a431;
    const R a1643 = K(8.0) * a431;
    const R a1644 = p[3] - p[2];
    const R a1645 = a1643 / a1644;
    parts[40] = a1645;
    parts[41] = K(0.0);
    parts[42] = K(0.0);
    parts[43] = K(0.0);
    parts[44] = K(0.0);
    parts[45] = K(0.0);
    parts[46] = K(0.0);
    parts[47] = K(0.0);
    parts[48] = K(0.0);
    parts[49] = K(0.0);
    parts[51] = K(0.0);
    parts[52] = K(0.0);
    parts[50] = K(8.0);
}

void half_car_acceleration_slope_parts(R t, const R *restrict y, const R *restrict p, R *restrict slope, R *restrict parts)
{
    (void)t;
    slope[0] = K(0.0);
    slope[1] = K(0.0);
    slope[2] = K(0.0);
    slope[3] = K(0.0);
    slope[4] = K(0.0);
    slope[5] = K(0.0);
    slope[6] = K(0.0);
    slope[7] = K(0.0);
    const R a8 = y[9] * p[13];
    slope[8] = a8;
    const R a10 = K(-8.1) * y[9];
    const R a11 = a10 * p[13];
    const R a12 = K(-0.8) * y[8];
    const R a13 = a12 * p[13];
    const R a14 = a11 + a13;
    slope[9] = a14;
    const R a16 = y[11] * p[13];
    slope[10] = a16;
    const R a18 = K(-8.1) * y[11];
    const R a19 = a18 * p[13];
    const R a20 = K(-0.8) * y[10];
    const R a21 = a20 * p[13];
    const R a22 = a19 + a21;
    slope[11] = a22;
    slope[12] = K(0.0);
    slope[13] = K(0.0);
    slope[14] = K(0.0);
    slope[15] = K(0.0);
    slope[16] = K(0.0);
    slope[17] = K(0.0);
    slope[18] = K(0.0);
    slope[19] = K(0.0);
    const R a32 = y[21] * p[13];
    slope[20] = a32;
    const R a34 = K(-0.8) * p[13];
    const R a35 = y[20] * a34;
    const R a36 = K(-8.1) * p[13];
    const R a37 = y[21] * a36;
    const R a38 = a35 + a37;
    slope[21] = a38;
    const R a40 = y[23] * p[13];
    slope[22] = a40;
    const R a42 = K(-0.8) * p[13];
    const R a43 = y[22] * a42;
    const R a44 = K(-8.1) * p[13];
    const R a45 = y[23] * a44;
    const R a46 = a43 + a45;
    const R a47 = K(0.19739208802178718) * p[12];
    const R a48 = y[722] * a47;
    const R a49 = K(8.0) * a48;
    const R a50 = a49 * p[13];
    const R a51 = a46 + a50;
    slope[23] = a51;
    slope[24] = K(0.0);
    slope[25] = K(0.0);
    slope[26] = K(0.0);
    slope[27] = K(0.0);
    slope[28] = K(0.0);
    slope[29] = K(0.0);
    slope[30] = K(0.0);
    const R a60 = y[32] * p[13];
    slope[31] = a60;
    const R a62 = y[31] * a34;
    const R a63 = y[32] * a36;
    const R a64 = a62 + a63;
    slope[32] = a64;
    const R a66 = y[34] * p[13];
    slope[33] = a66;
    const R a68 = y[33] * a42;
    const R a69 = y[34] * a44;
    const R a70 = a68 + a69;
    const R a71 = y[723] * a47;
    const R a72 = K(8.0) * a71;
    const R a73 = a72 * p[13];
    const R a74 = a70 + a73;
    slope[34] = a74;
    slope[35] = K(0.0);
    slope[36] = K(0.0);
    slope[37] = K(0.0);
    slope[38] = K(0.0);
    slope[39] = K(0.0);
    slope[40] = K(0.0);
    const R a82 = y[42] * p[13];
    slope[41] = a82;
    const R a84 = y[41] * a34;
    const R a85 = y[42] * a36;
    const R a86 = a84 + a85;
    slope[42] = a86;
    const R a88 = y[44] * p[13];
    slope[43] = a88;
    const R a90 = y[43] * a42;
    const R a91 = y[44] * a44;
    const R a92 = a90 + a91;
    const R a93 = y[724] * a47;
    const R a94 = K(8.0) * a93;
    const R a95 = a94 * p[13];
    const R a96 = a92 + a95;
    slope[44] = a96;
    slope[45] = K(0.0);
    slope[46] = K(0.0);
    slope[47] = K(0.0);
    slope[48] = K(0.0);
    slope[49] = K(0.0);
    const R a103 = y[51] * p[13];
    slope[50] = a103;
    const R a105 = y[50] * a34;
    const R a106 = y[51] * a36;
    const R a107 = a105 + a106;
    slope[51] = a107;
    const R a109 = y[53] * p[13];
    slope[52] = a109;
    const R a111 = y[52] * a42;
    const R a112 = y[53] * a44;
    const R a113 = a111 + a112;
    const R a114 = y[725] * a47;
    const R a115 = K(8.0) * a114;
    const R a116 = a115 * p[13];
    const R a117 = a113 + a116;
    slope[53] = a117;
    slope[54] = K(0.0);
    slope[55] = K(0.0);
    slope[56] = K(0.0);
    slope[57] = K(0.0);
    const R a123 = y[59] * p[13];
    slope[58] = a123;
    const R a125 = y[58] * a34;
    const R a126 = y[59] * a36;
    const R a127 = a125 + a126;
    slope[59] = a127;
    const R a129 = y[61] * p[13];
    slope[60] = a129;
    const R a131 = y[60] * a42;
    const R a132 = y[61] * a44;
    const R a133 = a131 + a132;
    const R a134 = y[726] * a47;
    const R a135 = K(8.0) * a134;
    const R a136 = a135 * p[13];
    const R a137 = a133 + a136;
    slope[61] = a137;
    slope[62] = K(0.0);
    slope[63] = K(0.0);
    slope[64] = K(0.0);
    const R a142 = y[66] * p[13];
    slope[65] = a142;
    const R a144 = y[65] * a34;
    const R a145 = y[66] * a36;
    const R a146 = a144 + a145;
    slope[66] = a146;
    const R a148 = y[68] * p[13];
    slope[67] = a148;
    const R a150 = y[67] * a42;
    const R a151 = y[68] * a44;
    const R a152 = a150 + a151;
    const R a153 = y[727] * a47;
    const R a154 = K(8.0) * a153;
    const R a155 = a154 * p[13];
    const R a156 = a152 + a155;
    slope[68] = a156;
    slope[69] = K(0.0);
    slope[70] = K(0.0);
    const R a160 = y[72] * p[13];
    slope[71] = a160;
    const R a162 = y[71] * a34;
    const R a163 = y[72] * a36;
    const R a164 = a162 + a163;
    slope[72] = a164;
    const R a166 = y[74] * p[13];
    slope[73] = a166;
    const R a168 = y[73] * a42;
    const R a169 = y[74] * a44;
    const R a170 = a168 + a169;
    const R a171 = y[728] * a47;
    const R a172 = K(8.0) * a171;
    const R a173 = a172 * p[13];
    const R a174 = a170 + a173;
    slope[74] = a174;
    slope[75] = K(0.0);
    const R a177 = y[77] * p[13];
    slope[76] = a177;
    const R a179 = y[76] * a34;
    const R a180 = y[77] * a36;
    const R a181 = a179 + a180;
    slope[77] = a181;
    const R a183 = y[79] * p[13];
    slope[78] = a183;
    const R a185 = y[78] * a42;
    const R a186 = y[79] * a44;
    const R a187 = a185 + a186;
    const R a188 = y[729] * a47;
    const R a189 = K(8.0) * a188;
    const R a190 = a189 * p[13];
    const R a191 = a187 + a190;
    slope[79] = a191;
    const R a193 = y[81] * p[13];
    const R a194 = a193 + a193;
    slope[80] = a194;
    const R a196 = y[80] * a34;
    const R a197 = y[81] * a36;
    const R a198 = a196 + a197;
    const R a199 = y[84] * p[13];
    const R a200 = a198 + a199;
    slope[81] = a200;
    const R a202 = y[83] * p[13];
    const R a203 = y[85] * p[13];
    const R a204 = a202 + a203;
    slope[82] = a204;
    const R a206 = y[82] * a42;
    const R a207 = y[83] * a44;
    const R a208 = a206 + a207;
    const R a209 = y[86] * p[13];
    const R a210 = a208 + a209;
    const R a211 = y[888] * a47;
    const R a212 = K(8.0) * a211;
    const R a213 = a212 * p[13];
    const R a214 = a210 + a213;
    slope[83] = a214;
    const R a216 = y[81] * a34;
    const R a217 = y[84] * a36;
    const R a218 = a216 + a217;
    const R a219 = a218 + a218;
    const R a220 = K(1.28) * p[12];
    const R a221 = a220 * p[13];
    const R a222 = K(9.869604401089358) * a221;
    const R a223 = a219 + a222;
    slope[84] = a223;
    const R a225 = y[86] * p[13];
    const R a226 = y[82] * a34;
    const R a227 = y[85] * a36;
    const R a228 = a226 + a227;
    const R a229 = a225 + a228;
    slope[85] = a229;
    const R a231 = y[85] * a42;
    const R a232 = y[86] * a44;
    const R a233 = a231 + a232;
    const R a234 = y[83] * a34;
    const R a235 = y[86] * a36;
    const R a236 = a234 + a235;
    const R a237 = a233 + a236;
    const R a238 = y[889] * a47;
    const R a239 = K(8.0) * a238;
    const R a240 = a239 * p[13];
    const R a241 = a237 + a240;
    slope[86] = a241;
    const R a243 = y[88] * p[13];
    const R a244 = a243 + a243;
    slope[87] = a244;
    const R a246 = y[87] * a42;
    const R a247 = y[88] * a44;
    const R a248 = a246 + a247;
    const R a249 = y[89] * p[13];
    const R a250 = a248 + a249;
    slope[88] = a250;
    const R a252 = y[88] * a42;
    const R a253 = y[89] * a44;
    const R a254 = a252 + a253;
    const R a255 = a254 + a254;
    const R a256 = K(1.28) * p[12];
    const R a257 = a256 * p[13];
    const R a258 = K(9.869604401089358) * a257;
    const R a259 = a255 + a258;
    slope[89] = a259;
    parts[0] = K(0.0);
    parts[1] = K(0.0);
    parts[2] = K(0.0);
    parts[3] = K(0.0);
    parts[4] = K(0.0);
    parts[5] = K(0.0);
    parts[6] = K(0.0);
    parts[7] = K(0.0);
    parts[8] = K(0.0);
    parts[9] = K(0.0);
    parts[10] = K(0.0);
    parts[11] = K(0.0);
    parts[12] = K(0.0);
    parts[13] = K(0.0);
    parts[14] = K(0.0);
    parts[15] = K(0.0);
    parts[16] = K(0.0);
    parts[17] = K(0.0);
    parts[18] = K(0.0);
    parts[19] = K(0.0);
    parts[20] = K(0.0);
    parts[21] = K(0.0);
    parts[22] = K(0.0);
    parts[23] = K(0.0);
    parts[24] = K(0.0);
    parts[25] = K(0.0);
    parts[26] = K(0.0);
    parts[27] = K(0.0);
    parts[28] = K(0.0);
    parts[29] = K(0.0);
    parts[30] = K(0.0);
    parts[31] = K(0.0);
    parts[32] = K(0.0);
    const R a294 = K(-0.8) * p[13];
    parts[33] = a294;
    parts[34] = p[13];
    const R a297 = K(-8.1) * p[13];
    parts[35] = a297;
    parts[36] = K(0.0);
    const R a300 = K(-0.8) * p[13];
    parts[37] = a300;
    parts[38] = p[13];
    const R a303 = K(-8.1) * p[13];
    parts[39] = a303;
    const R a305 = K(8.0) * p[13];
    const R a306 = p[3] - p[2];
    const R a307 = a305 / a306;
    parts[40] = a307;
    parts[41] = K(0.0);
    parts[42] = K(0.0);
    parts[43] = K(0.0);
    parts[44] = K(0.0);
    parts[45] = K(0.0);
    parts[46] = K(0.0);
    parts[47] = K(0.0);
    parts[48] = K(0.0);
    parts[49] = K(0.0);
    parts[50] = K(0.0);
    parts[51] = K(0.0);
    parts[52] = K(0.0);
}
