/*
 * Quarter car on a measured road
 *
 * Mean and covariance of the states of a random vibration model (CADET), as C99. Written by cadet-sym 0.1.0
 * (CasADi 3.8.2); do not edit, export again.
 *
 * The moments y are packed: means of the states, then the lower triangle of their covariance column by column
 * (use measured_road_covariance), then what is integrated alongside. No function allocates memory or keeps any state; results
 * must not overlap arguments. Compile with -DMEASURED_ROAD_FLOAT for single precision.
 */
#ifndef MEASURED_ROAD_H
#define MEASURED_ROAD_H

#ifdef __cplusplus
extern "C" {
#define MEASURED_ROAD_RESTRICT
#else
#define MEASURED_ROAD_RESTRICT restrict
#endif

#ifdef MEASURED_ROAD_FLOAT
typedef float measured_road_real;
#else
typedef double measured_road_real;
#endif

enum {
    MEASURED_ROAD_STATES = 8,
    MEASURED_ROAD_PARAMETERS = 8,
    MEASURED_ROAD_OUTPUTS = 4,
    MEASURED_ROAD_MOMENTS = 44, /* means and covariances */
    MEASURED_ROAD_SIZE = 44, /* of y: the moments */
    MEASURED_ROAD_NONZEROS = 247, /* of the Jacobian */
    MEASURED_ROAD_SWITCHES = 0 /* functions of t and s whose sign changes at a breakpoint */
};

/* Operations of one evaluation; they do not depend on the data.
 * rate: 288 additions, 76 comparisons, 37 divisions, 2 function calls, 338 multiplications, 1 square roots
 * jacobian: 834 additions, 319 comparisons, 102 divisions, 2 function calls, 1082 multiplications, 1 square
 *   roots
 * outputs: 632 additions, 285 comparisons, 39 divisions, 8 function calls, 920 multiplications, 4 square roots
 */
enum {
    MEASURED_ROAD_RATE_OPERATIONS = 742,
    MEASURED_ROAD_OUTPUT_OPERATIONS = 1888
};

enum { /* states */
    MEASURED_ROAD_STATE_z_s = 0, /* z_s */
    MEASURED_ROAD_STATE_z_u = 1, /* z_u */
    MEASURED_ROAD_STATE_v_s = 2, /* v_s */
    MEASURED_ROAD_STATE_v_u = 3, /* v_u */
    MEASURED_ROAD_STATE_h_section_1 = 4, /* h.section_1 */
    MEASURED_ROAD_STATE_h_section_2 = 5, /* h.section_2 */
    MEASURED_ROAD_STATE_h_section_3 = 6, /* h.section_3 */
    MEASURED_ROAD_STATE_h_section_4 = 7 /* h.section_4 */
};
enum { /* parameters */
    MEASURED_ROAD_PARAMETER_m_s = 0, /* m_s, sprung mass, kg */
    MEASURED_ROAD_PARAMETER_m_u = 1, /* m_u, unsprung mass, kg */
    MEASURED_ROAD_PARAMETER_k_s = 2, /* k_s, suspension stiffness, N/m */
    MEASURED_ROAD_PARAMETER_c_s = 3, /* c_s, suspension damping, N*s/m */
    MEASURED_ROAD_PARAMETER_k_3 = 4, /* k_3, rubber stops, N/m^3 */
    MEASURED_ROAD_PARAMETER_gap = 5, /* gap, free travel to either stop, m */
    MEASURED_ROAD_PARAMETER_k_t = 6, /* k_t, tyre stiffness, N/m */
    MEASURED_ROAD_PARAMETER_V = 7 /* V, speed, m/s */
};
enum { /* outputs */
    MEASURED_ROAD_OUTPUT_stroke = 0, /* stroke */
    MEASURED_ROAD_OUTPUT_stop_force = 1, /* stop_force */
    MEASURED_ROAD_OUTPUT_tyre_deflection = 2, /* tyre_deflection */
    MEASURED_ROAD_OUTPUT_body_acceleration = 3 /* body_acceleration */
};
extern const char *const measured_road_model;
extern const char *const measured_road_state_names[];
extern const char *const measured_road_parameter_names[];
extern const char *const measured_road_output_names[];
extern const measured_road_real measured_road_default_parameters[];
extern const measured_road_real measured_road_duration;   /* of the model's own run */
extern const int measured_road_points;          /* output times of that run, both ends */
extern const measured_road_real measured_road_start_speed; /* V(0) at the default parameters */

/* Index into y of the covariance of two states. */
int measured_road_covariance(int i, int j);

/* dy/dt. */
void measured_road_rate(measured_road_real t, const measured_road_real *MEASURED_ROAD_RESTRICT y, const measured_road_real *MEASURED_ROAD_RESTRICT p, measured_road_real *MEASURED_ROAD_RESTRICT dy);

/* d(dy/dt)/dy: the MEASURED_ROAD_NONZEROS values, column by column; entry k stands in row measured_road_jacobian_row[k], and column j
 * holds the entries from measured_road_jacobian_column[j] up to, without, measured_road_jacobian_column[j + 1]. */
void measured_road_jacobian(measured_road_real t, const measured_road_real *MEASURED_ROAD_RESTRICT y, const measured_road_real *MEASURED_ROAD_RESTRICT p,
                  measured_road_real *MEASURED_ROAD_RESTRICT values);
extern const int measured_road_jacobian_column[];
extern const int measured_road_jacobian_row[];

/* The same as a full matrix, MEASURED_ROAD_SIZE by MEASURED_ROAD_SIZE, column by column. */
void measured_road_jacobian_dense(measured_road_real t, const measured_road_real *MEASURED_ROAD_RESTRICT y, const measured_road_real *MEASURED_ROAD_RESTRICT p,
                        measured_road_real *MEASURED_ROAD_RESTRICT matrix);

/* d(dy/dt)/dt. */
void measured_road_slope(measured_road_real t, const measured_road_real *MEASURED_ROAD_RESTRICT y, const measured_road_real *MEASURED_ROAD_RESTRICT p,
               measured_road_real *MEASURED_ROAD_RESTRICT slope);

/* Means and variances of the outputs. */
void measured_road_outputs(measured_road_real t, const measured_road_real *MEASURED_ROAD_RESTRICT y, const measured_road_real *MEASURED_ROAD_RESTRICT p,
                 measured_road_real *MEASURED_ROAD_RESTRICT mean, measured_road_real *MEASURED_ROAD_RESTRICT variance);

/* Speed, its rate, the distance (0 where it is integrated in y), the distance at the start. */
void measured_road_motion(measured_road_real t, const measured_road_real *MEASURED_ROAD_RESTRICT p, measured_road_real *MEASURED_ROAD_RESTRICT motion);

/* y at t = 0. */
void measured_road_initial(const measured_road_real *MEASURED_ROAD_RESTRICT p, measured_road_real *MEASURED_ROAD_RESTRICT y);

/* Breakpoints of a run: times at which an input changes abruptly and the integration must start anew, increasing.
 * Writes at most `room` of them and returns how many there are. */
int measured_road_breakpoints(const measured_road_real *p, measured_road_real duration, measured_road_real *times, int room);

/* ---- How a call ended ------------------------------------------------------------------------------------ */

typedef enum {
    MEASURED_ROAD_OK = 0,
    MEASURED_ROAD_TOO_MANY_STEPS, /* the explicit method on a stiff problem, or a tolerance that is too tight */
    MEASURED_ROAD_STEP_TOO_SMALL, /* the moments grow without bound, or the tolerance is below rounding */
    MEASURED_ROAD_NOT_FINITE,     /* a rate is not a number: check the parameters and the start */
    MEASURED_ROAD_SINGULAR,       /* a linear system has no solution: states, or a combination of them, drift without bound */
    MEASURED_ROAD_NO_CONVERGENCE, /* no stationary moments were found from this start */
    MEASURED_ROAD_NOT_SEMIDEFINITE /* what was found is not a covariance */
} measured_road_status;

const char *measured_road_status_text(measured_road_status status);

/* ---- Propagation ----------------------------------------------------------------------------------------- */

/* A linear system with the Jacobian, decomposed. */
typedef struct {
    measured_road_real matrix[MEASURED_ROAD_SIZE * MEASURED_ROAD_SIZE];
    int pivots[MEASURED_ROAD_SIZE];
} measured_road_factors;

/* Working memory of the stiff method; of no interest otherwise. */
typedef struct {
    measured_road_real values[MEASURED_ROAD_NONZEROS > 0 ? MEASURED_ROAD_NONZEROS : 1];
    measured_road_real stages[6][MEASURED_ROAD_SIZE];
    measured_road_real slope[MEASURED_ROAD_SIZE];
    measured_road_real diagonal[MEASURED_ROAD_SIZE];
    measured_road_factors factors;
} measured_road_stiff;

/* A run in progress. Set up with measured_road_begin; the fields up to the blank line may then be changed. */
typedef struct {
    measured_road_real rtol;         /* relative error of a step (default 1e-6) */
    measured_road_real floor;        /* what counts as zero, over a moment's own size (default 1e-4) */
    measured_road_real longest_step; /* default: no bound */
    long most_steps;       /* of one call (default 1000000) */
    measured_road_stiff *stiff;      /* 0: explicit (Dormand & Prince 5(4)); else Rosenbrock (Rodas 4(3)), with this memory */
    const measured_road_real *breakpoints; /* increasing; 0: none */
    int breakpoint_count;

    measured_road_real t;
    measured_road_real y[MEASURED_ROAD_SIZE];
    measured_road_real step; /* to be tried next */
    long steps, refused, rates;
    measured_road_real size[MEASURED_ROAD_SIZE];
    measured_road_real stages[7][MEASURED_ROAD_SIZE];
    measured_road_real trial[MEASURED_ROAD_SIZE];
    int settled; /* moments of the ground's filters that stay as they are */
    int fresh; /* stages[0] holds the rate at (t, y) */
} measured_road_run;

void measured_road_begin(measured_road_run *run, measured_road_real t, const measured_road_real *y);

/* Integrate to a later time. On failure `run` holds what was reached. */
measured_road_status measured_road_propagate(measured_road_run *run, const measured_road_real *p, measured_road_real until);

/* Fixed steps for real time: one step of the classical Runge-Kutta method, 4 rates. `work` has room for
 * 5 * MEASURED_ROAD_SIZE values. The cost is the same for all data: MEASURED_ROAD_STEP_OPERATIONS operations. */
void measured_road_fixed_step(measured_road_real t, measured_road_real step, measured_road_real *y, const measured_road_real *p, measured_road_real *work);
enum { MEASURED_ROAD_STEP_OPERATIONS = 4 * MEASURED_ROAD_RATE_OPERATIONS + 13 * MEASURED_ROAD_SIZE + 4 };

/* ---- Stationary moments ---------------------------------------------------------------------------------- */

typedef struct {
    measured_road_real values[MEASURED_ROAD_NONZEROS > 0 ? MEASURED_ROAD_NONZEROS : 1];
    measured_road_real second[MEASURED_ROAD_SIZE * MEASURED_ROAD_SIZE];
    measured_road_real third[MEASURED_ROAD_SIZE * MEASURED_ROAD_SIZE];
    measured_road_real vectors[11][MEASURED_ROAD_SIZE];
    measured_road_factors factors;
    int left_out[MEASURED_ROAD_SIZE];
} measured_road_stationary_work;

typedef struct {
    measured_road_real speed;    /* held constant; of no meaning without ground */
    measured_road_real t, s;     /* instant and place at which explicit dependence is frozen (default 0) */
    int most_steps;    /* of each method (default 200) */
    measured_road_real residual; /* of the moment equations over the size of their own terms */
    int steps;
    int stable;        /* as a fixed point of the moment equations */
    int drifting[MEASURED_ROAD_STATES]; /* 1: the state has no stationary moments, and nothing depends on it; its moments are NaN */
    measured_road_stationary_work *work;
} measured_road_stationary_problem;

void measured_road_stationary_begin(measured_road_stationary_problem *problem, measured_road_real speed, measured_road_stationary_work *work);

/* 1: rates depend on t or s, so that nothing is stationary but with both frozen. */
enum { MEASURED_ROAD_EXPLICIT = 0 };

/* Stationary moments near y (Newton, then pseudo-transient continuation); with all of y zero, from next to none. */
measured_road_status measured_road_stationary(measured_road_stationary_problem *problem, const measured_road_real *p, measured_road_real *y);

/* y at t = 0, stationary where the model starts so (`work` is needed then only; 0 else). */
enum { MEASURED_ROAD_STEADY_START = 0 };
measured_road_status measured_road_start(const measured_road_real *p, measured_road_stationary_work *work, measured_road_real *y);

/* The rate, its Jacobian (pattern as above) and the outputs at a speed held constant. */
void measured_road_held_rate(measured_road_real t, measured_road_real s, measured_road_real V, const measured_road_real *MEASURED_ROAD_RESTRICT y,
                   const measured_road_real *MEASURED_ROAD_RESTRICT p, measured_road_real *MEASURED_ROAD_RESTRICT dy);
void measured_road_held_jacobian(measured_road_real t, measured_road_real s, measured_road_real V, const measured_road_real *MEASURED_ROAD_RESTRICT y,
                       const measured_road_real *MEASURED_ROAD_RESTRICT p, measured_road_real *MEASURED_ROAD_RESTRICT values);
void measured_road_held_outputs(measured_road_real t, measured_road_real s, measured_road_real V, const measured_road_real *MEASURED_ROAD_RESTRICT y,
                      const measured_road_real *MEASURED_ROAD_RESTRICT p, measured_road_real *MEASURED_ROAD_RESTRICT mean,
                      measured_road_real *MEASURED_ROAD_RESTRICT variance);

/* ---- Parts of the above ---------------------------------------------------------------------------------- */

/* Functions of t and s whose sign changes at a breakpoint. */
void measured_road_switches(measured_road_real t, measured_road_real s, const measured_road_real *MEASURED_ROAD_RESTRICT p, measured_road_real *MEASURED_ROAD_RESTRICT values);
/* 1 if the distance is integrated in y, at index MEASURED_ROAD_MOMENTS; else it is known in closed form. */
enum { MEASURED_ROAD_DISTANCE = 0 };

/* LU decomposition with pivoting, in place, of a full matrix (column by column); 0 if it is singular. */
int measured_road_decompose(int n, measured_road_real *matrix, int *pivots);
void measured_road_solve(int n, const measured_road_real *matrix, const int *pivots, measured_road_real *x);
/* factor * Jacobian + a diagonal matrix, decomposed; 0 if it is singular. x becomes the solution for x. */
int measured_road_factorise(const measured_road_real *values, measured_road_real factor, const measured_road_real *diagonal, measured_road_factors *factors);
void measured_road_backsolve(const measured_road_factors *factors, measured_road_real *x);
/* Add factor * Jacobian to a full matrix. */
void measured_road_add_jacobian(const measured_road_real *values, measured_road_real factor, measured_road_real *matrix);

#ifdef __cplusplus
}
#endif
#endif
