/* The ground between wheels on one track, for the sources of this library only. */
#ifndef @P@_GROUND_H
#define @P@_GROUND_H
#include "@p@_real.h"

enum {
    @P@_HEAD = @head@, /* entries of y before the correlation with that ground */
    @P@_ACTIVE = @active@, /* entries of y before what is known of it and does not change */
    @P@_ROWS = @rows@, /* states whose rows are carried along; those of the ground's filters are known where it is the same all along */
    @P@_PARTS = @parts@, /* entries of N, then speeds, then what wheels add; see @p@_rate_parts */
    @P@_GAIN = @gain@, /* entries of N */
    @P@_GAPS = @gaps@,
    @P@_LONGEST = @longest@, /* values of one noise in one gap */
    @P@_COLLOCATED = @collocated@ /* values of one noise in one element */
};

/* A gap between two wheels: elements, in each of them modes (Legendre coefficients, and what leaves the element), in
 * every mode columns of @P@_ROWS values. */
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
} @p@_gap;

extern const @p@_gap @p@_gaps[];

/* x becomes exp(C d) x: r rows, column by column. */
void @p@_carry(int r, const R *C, R d, int columns, R *x);
/* Modes of all elements of a gap of G' = scale C G / h, and what leaves it, from the inflow: r rows, one column. */
void @p@_collocate(const @p@_gap *gap, int r, const R *C, R scale, R *tail, R *values);
/* Index in y of a state's value in mode k of a gap, counted from its first element, for noise q; -1: it is zero. */
int @p@_ground_place(const @p@_gap *gap, int k, int q, int state);
/* What is known of G, as the equations of motion have it. */
void @p@_know_ground(R t, R s, const R *p, R *y);
/* G in steady travel, exactly, for the gains at y; V > 0. */
void @p@_travelled(R t, R s, R V, const R *p, R *y);
#endif
