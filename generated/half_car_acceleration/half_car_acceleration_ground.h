/* The ground between wheels on one track, for the sources of this library only. */
#ifndef HALF_CAR_ACCELERATION_GROUND_H
#define HALF_CAR_ACCELERATION_GROUND_H
#include "half_car_acceleration_real.h"

enum {
    HALF_CAR_ACCELERATION_HEAD = 90, /* entries of y before the correlation with that ground */
    HALF_CAR_ACCELERATION_ACTIVE = 730, /* entries of y before what is known of it and does not change */
    HALF_CAR_ACCELERATION_ROWS = 8, /* states whose rows are carried along; those of the ground's filters are known where it is the same all along */
    HALF_CAR_ACCELERATION_PARTS = 53, /* entries of N, then speeds, then what wheels add; see half_car_acceleration_rate_parts */
    HALF_CAR_ACCELERATION_GAIN = 40, /* entries of N */
    HALF_CAR_ACCELERATION_GAPS = 1,
    HALF_CAR_ACCELERATION_LONGEST = 160, /* values of one noise in one gap */
    HALF_CAR_ACCELERATION_COLLOCATED = 20 /* values of one noise in one element */
};

/* A gap between two wheels: elements, in each of them modes (Legendre coefficients, and what leaves the element), in
 * every mode columns of HALF_CAR_ACCELERATION_ROWS values. */
typedef struct {
    int first;       /* index in y of its first value */
    int known_first; /* the same of what is known, `known` values a column */
    int known;
    int columns;  /* one for each noise */
    int elements;
    int modes;
    int joined;   /* 1: what leaves the gap in front enters, too */
    int entering; /* index among the parts of what the wheel in front of it adds: columns of all states */
    const int *known_states;
    const R *derivative; /* (modes, 1 + modes) on {inflow, modes}, row by row, over the length of an element */
    const R *places; /* of the right-Radau nodes in an element, up to 1 */
    const R *from_nodes; /* (modes, nodes): modes of what has these values at the nodes, row by row */
} half_car_acceleration_gap;

extern const half_car_acceleration_gap half_car_acceleration_gaps[];

/* x becomes exp(C d) x: r rows, column by column. */
void half_car_acceleration_carry(int r, const R *C, R d, int columns, R *x);
/* Modes of all elements of a gap of G' = scale C G / h, and what leaves it, from the inflow: r rows, one column. */
void half_car_acceleration_collocate(const half_car_acceleration_gap *gap, int r, const R *C, R scale, R *tail, R *values);
/* Index in y of a state's value in mode k of a gap, counted from its first element, for noise q; -1: it is zero. */
int half_car_acceleration_ground_place(const half_car_acceleration_gap *gap, int k, int q, int state);
/* What is known of G, as the equations of motion have it. */
void half_car_acceleration_know_ground(R t, R s, const R *p, R *y);
/* G in steady travel, exactly, for the gains at y; V > 0. */
void half_car_acceleration_travelled(R t, R s, R V, const R *p, R *y);
#endif
