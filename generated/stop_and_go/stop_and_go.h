/*
 * Quarter car in stop-and-go traffic
 *
 * Mean and covariance of the states of a random vibration model (CADET), as C99. Written by cadet-sym 0.1.0
 * (CasADi 3.8.2); do not edit, export again.
 *
 * The moments y are packed: means of the states, then the lower triangle of their covariance column by column
 * (use stop_and_go_covariance), then what is integrated alongside. No function allocates memory or keeps any state; results
 * must not overlap arguments. Compile with -DSTOP_AND_GO_FLOAT for single precision.
 */
#ifndef STOP_AND_GO_H
#define STOP_AND_GO_H

#ifdef __cplusplus
extern "C" {
#define STOP_AND_GO_RESTRICT
#else
#define STOP_AND_GO_RESTRICT restrict
#endif

#ifdef STOP_AND_GO_FLOAT
typedef float stop_and_go_real;
#else
typedef double stop_and_go_real;
#endif

enum {
    STOP_AND_GO_STATES = 6,
    STOP_AND_GO_PARAMETERS = 9,
    STOP_AND_GO_OUTPUTS = 4,
    STOP_AND_GO_MOMENTS = 27, /* means and covariances */
    STOP_AND_GO_SIZE = 27, /* of y: the moments */
    STOP_AND_GO_NONZEROS = 145, /* of the Jacobian */
    STOP_AND_GO_SWITCHES = 4 /* functions of t and s whose sign changes at a breakpoint */
};

/* Operations of one evaluation; they do not depend on the data.
 * rate: 201 additions, 102 comparisons, 36 divisions, 2 function calls, 187 multiplications, 1 square roots
 * jacobian: 651 additions, 292 comparisons, 105 divisions, 2 function calls, 900 multiplications, 1 square roots
 * outputs: 251 additions, 170 comparisons, 23 divisions, 4 function calls, 189 multiplications, 2 square roots
 */
enum {
    STOP_AND_GO_RATE_OPERATIONS = 529,
    STOP_AND_GO_OUTPUT_OPERATIONS = 639
};

enum { /* states */
    STOP_AND_GO_STATE_z_s = 0, /* z_s */
    STOP_AND_GO_STATE_z_u = 1, /* z_u */
    STOP_AND_GO_STATE_v_s = 2, /* v_s */
    STOP_AND_GO_STATE_v_u = 3, /* v_u */
    STOP_AND_GO_STATE_h_height = 4, /* h.height */
    STOP_AND_GO_STATE_h_slope = 5 /* h.slope */
};
enum { /* parameters */
    STOP_AND_GO_PARAMETER_m_s = 0, /* m_s, sprung mass, kg */
    STOP_AND_GO_PARAMETER_m_u = 1, /* m_u, unsprung mass, kg */
    STOP_AND_GO_PARAMETER_k_s = 2, /* k_s, suspension stiffness, N/m */
    STOP_AND_GO_PARAMETER_c_s = 3, /* c_s, damping below v_0, N*s/m */
    STOP_AND_GO_PARAMETER_v_0 = 4, /* v_0, where the damper gives way, m/s */
    STOP_AND_GO_PARAMETER_share = 5, /* share, of c_s above v_0, 1 */
    STOP_AND_GO_PARAMETER_k_t = 6, /* k_t, tyre stiffness, N/m */
    STOP_AND_GO_PARAMETER_G_d = 7, /* G_d, roughness of class D at 0.1 cycle/m, m^3 */
    STOP_AND_GO_PARAMETER_V = 8 /* V, speed between stops, m/s */
};
enum { /* outputs */
    STOP_AND_GO_OUTPUT_stroke = 0, /* stroke */
    STOP_AND_GO_OUTPUT_tyre_deflection = 1, /* tyre_deflection */
    STOP_AND_GO_OUTPUT_body_acceleration = 2, /* body_acceleration */
    STOP_AND_GO_OUTPUT_road = 3 /* road */
};
extern const char *const stop_and_go_model;
extern const char *const stop_and_go_state_names[];
extern const char *const stop_and_go_parameter_names[];
extern const char *const stop_and_go_output_names[];
extern const stop_and_go_real stop_and_go_default_parameters[];
extern const stop_and_go_real stop_and_go_duration;   /* of the model's own run */
extern const int stop_and_go_points;          /* output times of that run, both ends */
extern const stop_and_go_real stop_and_go_start_speed; /* V(0) at the default parameters */

/* Index into y of the covariance of two states. */
int stop_and_go_covariance(int i, int j);

/* dy/dt. */
void stop_and_go_rate(stop_and_go_real t, const stop_and_go_real *STOP_AND_GO_RESTRICT y, const stop_and_go_real *STOP_AND_GO_RESTRICT p, stop_and_go_real *STOP_AND_GO_RESTRICT dy);

/* d(dy/dt)/dy: the STOP_AND_GO_NONZEROS values, column by column; entry k stands in row stop_and_go_jacobian_row[k], and column j
 * holds the entries from stop_and_go_jacobian_column[j] up to, without, stop_and_go_jacobian_column[j + 1]. */
void stop_and_go_jacobian(stop_and_go_real t, const stop_and_go_real *STOP_AND_GO_RESTRICT y, const stop_and_go_real *STOP_AND_GO_RESTRICT p,
                  stop_and_go_real *STOP_AND_GO_RESTRICT values);
extern const int stop_and_go_jacobian_column[];
extern const int stop_and_go_jacobian_row[];

/* The same as a full matrix, STOP_AND_GO_SIZE by STOP_AND_GO_SIZE, column by column. */
void stop_and_go_jacobian_dense(stop_and_go_real t, const stop_and_go_real *STOP_AND_GO_RESTRICT y, const stop_and_go_real *STOP_AND_GO_RESTRICT p,
                        stop_and_go_real *STOP_AND_GO_RESTRICT matrix);

/* d(dy/dt)/dt. */
void stop_and_go_slope(stop_and_go_real t, const stop_and_go_real *STOP_AND_GO_RESTRICT y, const stop_and_go_real *STOP_AND_GO_RESTRICT p,
               stop_and_go_real *STOP_AND_GO_RESTRICT slope);

/* Means and variances of the outputs. */
void stop_and_go_outputs(stop_and_go_real t, const stop_and_go_real *STOP_AND_GO_RESTRICT y, const stop_and_go_real *STOP_AND_GO_RESTRICT p,
                 stop_and_go_real *STOP_AND_GO_RESTRICT mean, stop_and_go_real *STOP_AND_GO_RESTRICT variance);

/* Speed, its rate, the distance (0 where it is integrated in y), the distance at the start. */
void stop_and_go_motion(stop_and_go_real t, const stop_and_go_real *STOP_AND_GO_RESTRICT p, stop_and_go_real *STOP_AND_GO_RESTRICT motion);

/* y at t = 0. */
void stop_and_go_initial(const stop_and_go_real *STOP_AND_GO_RESTRICT p, stop_and_go_real *STOP_AND_GO_RESTRICT y);

/* Breakpoints of a run: times at which an input changes abruptly and the integration must start anew, increasing.
 * Writes at most `room` of them and returns how many there are. */
int stop_and_go_breakpoints(const stop_and_go_real *p, stop_and_go_real duration, stop_and_go_real *times, int room);

/* ---- How a call ended ------------------------------------------------------------------------------------ */

typedef enum {
    STOP_AND_GO_OK = 0,
    STOP_AND_GO_TOO_MANY_STEPS, /* the explicit method on a stiff problem, or a tolerance that is too tight */
    STOP_AND_GO_STEP_TOO_SMALL, /* the moments grow without bound, or the tolerance is below rounding */
    STOP_AND_GO_NOT_FINITE,     /* a rate is not a number: check the parameters and the start */
    STOP_AND_GO_SINGULAR,       /* a linear system has no solution: states, or a combination of them, drift without bound */
    STOP_AND_GO_NO_CONVERGENCE, /* no stationary moments were found from this start */
    STOP_AND_GO_NOT_SEMIDEFINITE /* what was found is not a covariance */
} stop_and_go_status;

const char *stop_and_go_status_text(stop_and_go_status status);

/* ---- Propagation ----------------------------------------------------------------------------------------- */

/* A linear system with the Jacobian, decomposed. */
typedef struct {
    stop_and_go_real matrix[STOP_AND_GO_SIZE * STOP_AND_GO_SIZE];
    int pivots[STOP_AND_GO_SIZE];
} stop_and_go_factors;

/* Working memory of the stiff method; of no interest otherwise. */
typedef struct {
    stop_and_go_real values[STOP_AND_GO_NONZEROS > 0 ? STOP_AND_GO_NONZEROS : 1];
    stop_and_go_real stages[6][STOP_AND_GO_SIZE];
    stop_and_go_real slope[STOP_AND_GO_SIZE];
    stop_and_go_real diagonal[STOP_AND_GO_SIZE];
    stop_and_go_factors factors;
} stop_and_go_stiff;

/* A run in progress. Set up with stop_and_go_begin; the fields up to the blank line may then be changed. */
typedef struct {
    stop_and_go_real rtol;         /* relative error of a step (default 1e-6) */
    stop_and_go_real floor;        /* what counts as zero, over a moment's own size (default 1e-4) */
    stop_and_go_real longest_step; /* default: no bound */
    long most_steps;       /* of one call (default 1000000) */
    stop_and_go_stiff *stiff;      /* 0: explicit (Dormand & Prince 5(4)); else Rosenbrock (Rodas 4(3)), with this memory */
    const stop_and_go_real *breakpoints; /* increasing; 0: none */
    int breakpoint_count;

    stop_and_go_real t;
    stop_and_go_real y[STOP_AND_GO_SIZE];
    stop_and_go_real step; /* to be tried next */
    long steps, refused, rates;
    stop_and_go_real size[STOP_AND_GO_SIZE];
    stop_and_go_real stages[7][STOP_AND_GO_SIZE];
    stop_and_go_real trial[STOP_AND_GO_SIZE];
    int settled; /* moments of the ground's filters that stay as they are */
    int fresh; /* stages[0] holds the rate at (t, y) */
} stop_and_go_run;

void stop_and_go_begin(stop_and_go_run *run, stop_and_go_real t, const stop_and_go_real *y);

/* Integrate to a later time. On failure `run` holds what was reached. */
stop_and_go_status stop_and_go_propagate(stop_and_go_run *run, const stop_and_go_real *p, stop_and_go_real until);

/* Fixed steps for real time: one step of the classical Runge-Kutta method, 4 rates. `work` has room for
 * 5 * STOP_AND_GO_SIZE values. The cost is the same for all data: STOP_AND_GO_STEP_OPERATIONS operations. */
void stop_and_go_fixed_step(stop_and_go_real t, stop_and_go_real step, stop_and_go_real *y, const stop_and_go_real *p, stop_and_go_real *work);
enum { STOP_AND_GO_STEP_OPERATIONS = 4 * STOP_AND_GO_RATE_OPERATIONS + 13 * STOP_AND_GO_SIZE + 4 };

/* ---- Stationary moments ---------------------------------------------------------------------------------- */

typedef struct {
    stop_and_go_real values[STOP_AND_GO_NONZEROS > 0 ? STOP_AND_GO_NONZEROS : 1];
    stop_and_go_real second[STOP_AND_GO_SIZE * STOP_AND_GO_SIZE];
    stop_and_go_real third[STOP_AND_GO_SIZE * STOP_AND_GO_SIZE];
    stop_and_go_real vectors[11][STOP_AND_GO_SIZE];
    stop_and_go_factors factors;
    int left_out[STOP_AND_GO_SIZE];
} stop_and_go_stationary_work;

typedef struct {
    stop_and_go_real speed;    /* held constant; of no meaning without ground */
    stop_and_go_real t, s;     /* instant and place at which explicit dependence is frozen (default 0) */
    int most_steps;    /* of each method (default 200) */
    stop_and_go_real residual; /* of the moment equations over the size of their own terms */
    int steps;
    int stable;        /* as a fixed point of the moment equations */
    int drifting[STOP_AND_GO_STATES]; /* 1: the state has no stationary moments, and nothing depends on it; its moments are NaN */
    stop_and_go_stationary_work *work;
} stop_and_go_stationary_problem;

void stop_and_go_stationary_begin(stop_and_go_stationary_problem *problem, stop_and_go_real speed, stop_and_go_stationary_work *work);

/* 1: rates depend on t or s, so that nothing is stationary but with both frozen. */
enum { STOP_AND_GO_EXPLICIT = 0 };

/* Stationary moments near y (Newton, then pseudo-transient continuation); with all of y zero, from next to none. */
stop_and_go_status stop_and_go_stationary(stop_and_go_stationary_problem *problem, const stop_and_go_real *p, stop_and_go_real *y);

/* y at t = 0, stationary where the model starts so (`work` is needed then only; 0 else). */
enum { STOP_AND_GO_STEADY_START = 0 };
stop_and_go_status stop_and_go_start(const stop_and_go_real *p, stop_and_go_stationary_work *work, stop_and_go_real *y);

/* The rate, its Jacobian (pattern as above) and the outputs at a speed held constant. */
void stop_and_go_held_rate(stop_and_go_real t, stop_and_go_real s, stop_and_go_real V, const stop_and_go_real *STOP_AND_GO_RESTRICT y,
                   const stop_and_go_real *STOP_AND_GO_RESTRICT p, stop_and_go_real *STOP_AND_GO_RESTRICT dy);
void stop_and_go_held_jacobian(stop_and_go_real t, stop_and_go_real s, stop_and_go_real V, const stop_and_go_real *STOP_AND_GO_RESTRICT y,
                       const stop_and_go_real *STOP_AND_GO_RESTRICT p, stop_and_go_real *STOP_AND_GO_RESTRICT values);
void stop_and_go_held_outputs(stop_and_go_real t, stop_and_go_real s, stop_and_go_real V, const stop_and_go_real *STOP_AND_GO_RESTRICT y,
                      const stop_and_go_real *STOP_AND_GO_RESTRICT p, stop_and_go_real *STOP_AND_GO_RESTRICT mean,
                      stop_and_go_real *STOP_AND_GO_RESTRICT variance);

/* ---- Parts of the above ---------------------------------------------------------------------------------- */

/* Functions of t and s whose sign changes at a breakpoint. */
void stop_and_go_switches(stop_and_go_real t, stop_and_go_real s, const stop_and_go_real *STOP_AND_GO_RESTRICT p, stop_and_go_real *STOP_AND_GO_RESTRICT values);
/* 1 if the distance is integrated in y, at index STOP_AND_GO_MOMENTS; else it is known in closed form. */
enum { STOP_AND_GO_DISTANCE = 0 };

/* LU decomposition with pivoting, in place, of a full matrix (column by column); 0 if it is singular. */
int stop_and_go_decompose(int n, stop_and_go_real *matrix, int *pivots);
void stop_and_go_solve(int n, const stop_and_go_real *matrix, const int *pivots, stop_and_go_real *x);
/* factor * Jacobian + a diagonal matrix, decomposed; 0 if it is singular. x becomes the solution for x. */
int stop_and_go_factorise(const stop_and_go_real *values, stop_and_go_real factor, const stop_and_go_real *diagonal, stop_and_go_factors *factors);
void stop_and_go_backsolve(const stop_and_go_factors *factors, stop_and_go_real *x);
/* Add factor * Jacobian to a full matrix. */
void stop_and_go_add_jacobian(const stop_and_go_real *values, stop_and_go_real factor, stop_and_go_real *matrix);

#ifdef __cplusplus
}
#endif
#endif
