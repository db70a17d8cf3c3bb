/* The ground between wheels on one track, for the sources of this library only. */
#ifndef HALF_CAR_ACCELERATION_GROUND_H
#define HALF_CAR_ACCELERATION_GROUND_H
#include "half_car_acceleration_real.h"

enum {
    HALF_CAR_ACCELERATION_HEAD = 90, /* entries of y before the correlation with that ground */
    HALF_CAR_ACCELERATION_PARTS = 53, /* entries of N, then speeds, then what wheels add; see half_car_acceleration_rate_parts */
    HALF_CAR_ACCELERATION_GAIN = 40, /* entries of N */
    HALF_CAR_ACCELERATION_GAPS = 1
};

/* A gap between two wheels: elements, in each of them nodes, at every node columns of STATES values. */
typedef struct {
    int first;    /* index in y of its first value */
    int columns;  /* one for each noise */
    int elements;
    int nodes;
    int joined;   /* 1: what leaves the gap in front enters, too */
    int entering; /* index among the parts of what the wheel in front of it adds */
    const R *derivative; /* (nodes, nodes + 1) on {inflow, nodes}, row by row, over the length of an element */
    const R *places; /* of the nodes in an element, up to 1 */
} half_car_acceleration_gap;

extern const half_car_acceleration_gap half_car_acceleration_gaps[];

/* x becomes exp(C d) x: r rows, column by column. */
void half_car_acceleration_carry(int r, const R *C, R d, int columns, R *x);
/* G in steady travel, exactly, for the gains at y; V > 0. */
void half_car_acceleration_travelled(R t, R s, R V, const R *p, R *y);
#endif
