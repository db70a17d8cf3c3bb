/* The ground between wheels on one track, for the sources of this library only. */
#ifndef @P@_GROUND_H
#define @P@_GROUND_H
#include "@p@_real.h"

enum {
    @P@_HEAD = @head@, /* entries of y before the correlation with that ground */
    @P@_PARTS = @parts@, /* entries of N, then speeds, then what wheels add; see @p@_rate_parts */
    @P@_GAIN = @gain@, /* entries of N */
    @P@_GAPS = @gaps@
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
} @p@_gap;

extern const @p@_gap @p@_gaps[];

/* x becomes exp(C d) x: r rows, column by column. */
void @p@_carry(int r, const R *C, R d, int columns, R *x);
/* G in steady travel, exactly, for the gains at y; V > 0. */
void @p@_travelled(R t, R s, R V, const R *p, R *y);
#endif
