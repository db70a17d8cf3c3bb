/*
 * Quarter car with an asymmetric, digressive damper
 *
 * Mean and covariance of the states of a random vibration model (CADET), as C99. Written by cadet-sym 0.1.0
 * (CasADi 3.8.2); do not edit, export again.
 *
 * The moments y are packed: means of the states, then the lower triangle of their covariance column by column
 * (use quarter_car_damper_covariance), then what is integrated alongside. No function allocates memory or keeps any state; results
 * must not overlap arguments. Compile with -DQUARTER_CAR_DAMPER_FLOAT for single precision.
 */
#ifndef QUARTER_CAR_DAMPER_H
#define QUARTER_CAR_DAMPER_H

#ifdef __cplusplus
extern "C" {
#define QUARTER_CAR_DAMPER_RESTRICT
#else
#define QUARTER_CAR_DAMPER_RESTRICT restrict
#endif

#ifdef QUARTER_CAR_DAMPER_FLOAT
typedef float quarter_car_damper_real;
#else
typedef double quarter_car_damper_real;
#endif

enum {
    QUARTER_CAR_DAMPER_STATES = 5,
    QUARTER_CAR_DAMPER_PARAMETERS = 10,
    QUARTER_CAR_DAMPER_OUTPUTS = 4,
    QUARTER_CAR_DAMPER_MOMENTS = 20, /* means and covariances */
    QUARTER_CAR_DAMPER_SIZE = 20, /* of y: the moments */
    QUARTER_CAR_DAMPER_NONZEROS = 97, /* of the Jacobian */
    QUARTER_CAR_DAMPER_SWITCHES = 0 /* functions of t and s whose sign changes at a breakpoint */
};

/* Operations of one evaluation; they do not depend on the data.
 * rate: 347 additions, 196 comparisons, 41 divisions, 6 function calls, 311 multiplications, 1 square roots
 * jacobian: 1624 additions, 782 comparisons, 182 divisions, 6 function calls, 2265 multiplications, 1 square
 *   roots
 * outputs: 1345 additions, 728 comparisons, 104 divisions, 24 function calls, 1452 multiplications, 4 square
 *   roots
 */
enum {
    QUARTER_CAR_DAMPER_RATE_OPERATIONS = 902,
    QUARTER_CAR_DAMPER_OUTPUT_OPERATIONS = 3657
};

enum { /* states */
    QUARTER_CAR_DAMPER_STATE_d = 0, /* d */
    QUARTER_CAR_DAMPER_STATE_e = 1, /* e */
    QUARTER_CAR_DAMPER_STATE_v_s = 2, /* v_s */
    QUARTER_CAR_DAMPER_STATE_v_u = 3, /* v_u */
    QUARTER_CAR_DAMPER_STATE_h_height = 4 /* h.height */
};
enum { /* parameters */
    QUARTER_CAR_DAMPER_PARAMETER_m_s = 0, /* m_s, sprung mass, kg */
    QUARTER_CAR_DAMPER_PARAMETER_m_u = 1, /* m_u, unsprung mass, kg */
    QUARTER_CAR_DAMPER_PARAMETER_k_s = 2, /* k_s, suspension stiffness, N/m */
    QUARTER_CAR_DAMPER_PARAMETER_c_s = 3, /* c_s, mean of the slopes in rebound and bump, N*s/m */
    QUARTER_CAR_DAMPER_PARAMETER_a = 4, /* a, asymmetry: 0 for equal slopes */
    QUARTER_CAR_DAMPER_PARAMETER_v_b = 5, /* v_b, piston speed at which the valve opens, m/s */
    QUARTER_CAR_DAMPER_PARAMETER_q = 6, /* q, part of the slope left beyond it */
    QUARTER_CAR_DAMPER_PARAMETER_k_t = 7, /* k_t, tyre stiffness, N/m */
    QUARTER_CAR_DAMPER_PARAMETER_G_d = 8, /* G_d, roughness of class C at 0.1 cycle/m, m^3 */
    QUARTER_CAR_DAMPER_PARAMETER_V = 9 /* V, speed, m/s */
};
enum { /* outputs */
    QUARTER_CAR_DAMPER_OUTPUT_stroke = 0, /* stroke */
    QUARTER_CAR_DAMPER_OUTPUT_tyre_deflection = 1, /* tyre_deflection */
    QUARTER_CAR_DAMPER_OUTPUT_body_acceleration = 2, /* body_acceleration */
    QUARTER_CAR_DAMPER_OUTPUT_damper_force = 3 /* damper_force */
};
extern const char *const quarter_car_damper_model;
extern const char *const quarter_car_damper_state_names[];
extern const char *const quarter_car_damper_parameter_names[];
extern const char *const quarter_car_damper_output_names[];
extern const quarter_car_damper_real quarter_car_damper_default_parameters[];
extern const quarter_car_damper_real quarter_car_damper_duration;   /* of the model's own run */
extern const int quarter_car_damper_points;          /* output times of that run, both ends */
extern const quarter_car_damper_real quarter_car_damper_start_speed; /* V(0) at the default parameters */

/* Index into y of the covariance of two states. */
int quarter_car_damper_covariance(int i, int j);

/* dy/dt. */
void quarter_car_damper_rate(quarter_car_damper_real t, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT y, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT p, quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT dy);

/* d(dy/dt)/dy: the QUARTER_CAR_DAMPER_NONZEROS values, column by column; entry k stands in row quarter_car_damper_jacobian_row[k], and column j
 * holds the entries from quarter_car_damper_jacobian_column[j] up to, without, quarter_car_damper_jacobian_column[j + 1]. */
void quarter_car_damper_jacobian(quarter_car_damper_real t, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT y, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT p,
                  quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT values);
extern const int quarter_car_damper_jacobian_column[];
extern const int quarter_car_damper_jacobian_row[];

/* The same as a full matrix, QUARTER_CAR_DAMPER_SIZE by QUARTER_CAR_DAMPER_SIZE, column by column. */
void quarter_car_damper_jacobian_dense(quarter_car_damper_real t, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT y, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT p,
                        quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT matrix);

/* d(dy/dt)/dt. */
void quarter_car_damper_slope(quarter_car_damper_real t, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT y, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT p,
               quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT slope);

/* Means and variances of the outputs. */
void quarter_car_damper_outputs(quarter_car_damper_real t, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT y, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT p,
                 quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT mean, quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT variance);

/* Speed, its rate, the distance (0 where it is integrated in y), the distance at the start. */
void quarter_car_damper_motion(quarter_car_damper_real t, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT p, quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT motion);

/* y at t = 0. */
void quarter_car_damper_initial(const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT p, quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT y);

/* Breakpoints of a run: times at which an input changes abruptly and the integration must start anew, increasing.
 * Writes at most `room` of them and returns how many there are. */
int quarter_car_damper_breakpoints(const quarter_car_damper_real *p, quarter_car_damper_real duration, quarter_car_damper_real *times, int room);

/* ---- How a call ended ------------------------------------------------------------------------------------ */

typedef enum {
    QUARTER_CAR_DAMPER_OK = 0,
    QUARTER_CAR_DAMPER_TOO_MANY_STEPS, /* the explicit method on a stiff problem, or a tolerance that is too tight */
    QUARTER_CAR_DAMPER_STEP_TOO_SMALL, /* the moments grow without bound, or the tolerance is below rounding */
    QUARTER_CAR_DAMPER_NOT_FINITE,     /* a rate is not a number: check the parameters and the start */
    QUARTER_CAR_DAMPER_SINGULAR,       /* a linear system has no solution: states, or a combination of them, drift without bound */
    QUARTER_CAR_DAMPER_NO_CONVERGENCE, /* no stationary moments were found from this start */
    QUARTER_CAR_DAMPER_NOT_SEMIDEFINITE /* what was found is not a covariance */
} quarter_car_damper_status;

const char *quarter_car_damper_status_text(quarter_car_damper_status status);

/* ---- Propagation ----------------------------------------------------------------------------------------- */

/* A linear system with the Jacobian, decomposed. */
typedef struct {
    quarter_car_damper_real matrix[QUARTER_CAR_DAMPER_SIZE * QUARTER_CAR_DAMPER_SIZE];
    int pivots[QUARTER_CAR_DAMPER_SIZE];
} quarter_car_damper_factors;

/* Working memory of the stiff method; of no interest otherwise. */
typedef struct {
    quarter_car_damper_real values[QUARTER_CAR_DAMPER_NONZEROS > 0 ? QUARTER_CAR_DAMPER_NONZEROS : 1];
    quarter_car_damper_real stages[6][QUARTER_CAR_DAMPER_SIZE];
    quarter_car_damper_real slope[QUARTER_CAR_DAMPER_SIZE];
    quarter_car_damper_real diagonal[QUARTER_CAR_DAMPER_SIZE];
    quarter_car_damper_factors factors;
} quarter_car_damper_stiff;

/* A run in progress. Set up with quarter_car_damper_begin; the fields up to the blank line may then be changed. */
typedef struct {
    quarter_car_damper_real rtol;         /* relative error of a step (default 1e-6) */
    quarter_car_damper_real floor;        /* what counts as zero, over a moment's own size (default 1e-4) */
    quarter_car_damper_real longest_step; /* default: no bound */
    long most_steps;       /* of one call (default 1000000) */
    quarter_car_damper_stiff *stiff;      /* 0: explicit (Dormand & Prince 5(4)); else Rosenbrock (Rodas 4(3)), with this memory */
    const quarter_car_damper_real *breakpoints; /* increasing; 0: none */
    int breakpoint_count;

    quarter_car_damper_real t;
    quarter_car_damper_real y[QUARTER_CAR_DAMPER_SIZE];
    quarter_car_damper_real step; /* to be tried next */
    long steps, refused, rates;
    quarter_car_damper_real size[QUARTER_CAR_DAMPER_SIZE];
    quarter_car_damper_real stages[7][QUARTER_CAR_DAMPER_SIZE];
    quarter_car_damper_real trial[QUARTER_CAR_DAMPER_SIZE];
    int settled; /* moments of the ground's filters that stay as they are */
    int fresh; /* stages[0] holds the rate at (t, y) */
} quarter_car_damper_run;

void quarter_car_damper_begin(quarter_car_damper_run *run, quarter_car_damper_real t, const quarter_car_damper_real *y);

/* Integrate to a later time. On failure `run` holds what was reached. */
quarter_car_damper_status quarter_car_damper_propagate(quarter_car_damper_run *run, const quarter_car_damper_real *p, quarter_car_damper_real until);

/* Fixed steps for real time: one step of the classical Runge-Kutta method, 4 rates. `work` has room for
 * 5 * QUARTER_CAR_DAMPER_SIZE values. The cost is the same for all data: QUARTER_CAR_DAMPER_STEP_OPERATIONS operations. */
void quarter_car_damper_fixed_step(quarter_car_damper_real t, quarter_car_damper_real step, quarter_car_damper_real *y, const quarter_car_damper_real *p, quarter_car_damper_real *work);
enum { QUARTER_CAR_DAMPER_STEP_OPERATIONS = 4 * QUARTER_CAR_DAMPER_RATE_OPERATIONS + 13 * QUARTER_CAR_DAMPER_SIZE + 4 };

/* ---- Stationary moments ---------------------------------------------------------------------------------- */

typedef struct {
    quarter_car_damper_real values[QUARTER_CAR_DAMPER_NONZEROS > 0 ? QUARTER_CAR_DAMPER_NONZEROS : 1];
    quarter_car_damper_real second[QUARTER_CAR_DAMPER_SIZE * QUARTER_CAR_DAMPER_SIZE];
    quarter_car_damper_real third[QUARTER_CAR_DAMPER_SIZE * QUARTER_CAR_DAMPER_SIZE];
    quarter_car_damper_real vectors[11][QUARTER_CAR_DAMPER_SIZE];
    quarter_car_damper_factors factors;
    int left_out[QUARTER_CAR_DAMPER_SIZE];
} quarter_car_damper_stationary_work;

typedef struct {
    quarter_car_damper_real speed;    /* held constant; of no meaning without ground */
    quarter_car_damper_real t, s;     /* instant and place at which explicit dependence is frozen (default 0) */
    int most_steps;    /* of each method (default 200) */
    quarter_car_damper_real residual; /* of the moment equations over the size of their own terms */
    int steps;
    int stable;        /* as a fixed point of the moment equations */
    int drifting[QUARTER_CAR_DAMPER_STATES]; /* 1: the state has no stationary moments, and nothing depends on it; its moments are NaN */
    quarter_car_damper_stationary_work *work;
} quarter_car_damper_stationary_problem;

void quarter_car_damper_stationary_begin(quarter_car_damper_stationary_problem *problem, quarter_car_damper_real speed, quarter_car_damper_stationary_work *work);

/* 1: rates depend on t or s, so that nothing is stationary but with both frozen. */
enum { QUARTER_CAR_DAMPER_EXPLICIT = 0 };

/* Stationary moments near y (Newton, then pseudo-transient continuation); with all of y zero, from next to none. */
quarter_car_damper_status quarter_car_damper_stationary(quarter_car_damper_stationary_problem *problem, const quarter_car_damper_real *p, quarter_car_damper_real *y);

/* y at t = 0, stationary where the model starts so (`work` is needed then only; 0 else). */
enum { QUARTER_CAR_DAMPER_STEADY_START = 0 };
quarter_car_damper_status quarter_car_damper_start(const quarter_car_damper_real *p, quarter_car_damper_stationary_work *work, quarter_car_damper_real *y);

/* The rate, its Jacobian (pattern as above) and the outputs at a speed held constant. */
void quarter_car_damper_held_rate(quarter_car_damper_real t, quarter_car_damper_real s, quarter_car_damper_real V, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT y,
                   const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT p, quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT dy);
void quarter_car_damper_held_jacobian(quarter_car_damper_real t, quarter_car_damper_real s, quarter_car_damper_real V, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT y,
                       const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT p, quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT values);
void quarter_car_damper_held_outputs(quarter_car_damper_real t, quarter_car_damper_real s, quarter_car_damper_real V, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT y,
                      const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT p, quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT mean,
                      quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT variance);

/* ---- Parts of the above ---------------------------------------------------------------------------------- */

/* Functions of t and s whose sign changes at a breakpoint. */
void quarter_car_damper_switches(quarter_car_damper_real t, quarter_car_damper_real s, const quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT p, quarter_car_damper_real *QUARTER_CAR_DAMPER_RESTRICT values);
/* 1 if the distance is integrated in y, at index QUARTER_CAR_DAMPER_MOMENTS; else it is known in closed form. */
enum { QUARTER_CAR_DAMPER_DISTANCE = 0 };

/* LU decomposition with pivoting, in place, of a full matrix (column by column); 0 if it is singular. */
int quarter_car_damper_decompose(int n, quarter_car_damper_real *matrix, int *pivots);
void quarter_car_damper_solve(int n, const quarter_car_damper_real *matrix, const int *pivots, quarter_car_damper_real *x);
/* factor * Jacobian + a diagonal matrix, decomposed; 0 if it is singular. x becomes the solution for x. */
int quarter_car_damper_factorise(const quarter_car_damper_real *values, quarter_car_damper_real factor, const quarter_car_damper_real *diagonal, quarter_car_damper_factors *factors);
void quarter_car_damper_backsolve(const quarter_car_damper_factors *factors, quarter_car_damper_real *x);
/* Add factor * Jacobian to a full matrix. */
void quarter_car_damper_add_jacobian(const quarter_car_damper_real *values, quarter_car_damper_real factor, quarter_car_damper_real *matrix);

#ifdef __cplusplus
}
#endif
#endif
