#include "measured_road_real.h"

void measured_road_start_parts(const R *restrict p, R *restrict parts)
{
    (void)p;
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
    parts[33] = K(0.0);
    parts[34] = K(0.0);
    parts[35] = K(0.0);
    parts[36] = K(0.0);
    parts[37] = K(-0.00697801269025);
    parts[38] = K(0.0);
    parts[39] = K(0.58770819059075);
    parts[40] = K(1.0);
    parts[41] = K(-0.155714322484);
    parts[42] = K(0.0);
    parts[43] = K(0.206821404278);
    parts[44] = K(0.0);
    parts[45] = K(0.0);
    parts[46] = K(0.0);
    parts[47] = K(-0.607291345521);
    parts[48] = K(0.0);
    parts[49] = K(0.0);
    parts[50] = K(1.0);
    parts[51] = K(-0.1316267436918);
    parts[52] = K(0.0);
    parts[53] = K(0.0);
    parts[54] = K(0.0);
    parts[55] = K(0.0);
    parts[56] = K(0.0);
    parts[57] = K(5.35935269776e-05);
    parts[58] = K(0.0);
    parts[59] = K(5.35935269776e-05);
    parts[60] = K(0.0);
    parts[61] = K(0.0);
    parts[62] = K(0.0);
    parts[63] = K(0.0);
    parts[64] = K(0.0);
    parts[65] = K(5.35935269776e-05);
    parts[66] = K(0.0);
    parts[67] = K(5.35935269776e-05);
    parts[68] = K(0.0);
    parts[69] = K(0.00732076);
    parts[70] = K(0.0);
    parts[71] = K(0.00732076);
}

void measured_road_motion(R t, const R *restrict p, R *restrict motion)
{
    motion[0] = p[7];
    motion[1] = K(0.0);
    const R a2 = p[7] * t;
    motion[2] = a2;
    motion[3] = K(0.0);
}

void measured_road_switches(R t, R s, const R *restrict p, R *restrict g)
{
    (void)t;
    (void)s;
    (void)p;
    (void)g;
}
