/*
 * Quarter car where the road changes from class B to class D
 *
 * Mean and covariance of the states of a random vibration model (CADET), as C99. Written by cadet-sym 0.1.0
 * (CasADi 3.8.2); do not edit, export again.
 *
 * The moments y are packed: means of the states, then the lower triangle of their covariance column by column
 * (use road_class_change_covariance), then what is integrated alongside. No function allocates memory or keeps any state; results
 * must not overlap arguments. Compile with -DROAD_CLASS_CHANGE_FLOAT for single precision.
 */
#ifndef ROAD_CLASS_CHANGE_H
#define ROAD_CLASS_CHANGE_H

#ifdef __cplusplus
extern "C" {
#define ROAD_CLASS_CHANGE_RESTRICT
#else
#define ROAD_CLASS_CHANGE_RESTRICT restrict
#endif

#ifdef ROAD_CLASS_CHANGE_FLOAT
typedef float road_class_change_real;
#else
typedef double road_class_change_real;
#endif

enum {
    ROAD_CLASS_CHANGE_STATES = 6,
    ROAD_CLASS_CHANGE_PARAMETERS = 13,
    ROAD_CLASS_CHANGE_OUTPUTS = 4,
    ROAD_CLASS_CHANGE_MOMENTS = 27, /* means and covariances */
    ROAD_CLASS_CHANGE_SIZE = 27, /* of y: the moments */
    ROAD_CLASS_CHANGE_NONZEROS = 145, /* of the Jacobian */
    ROAD_CLASS_CHANGE_SWITCHES = 4 /* functions of t and s whose sign changes at a breakpoint */
};

/* Operations of one evaluation; they do not depend on the data.
 * rate: 134 additions, 54 comparisons, 24 divisions, 3 function calls, 134 multiplications, 1 square roots
 * jacobian: 347 additions, 113 comparisons, 63 divisions, 1 function calls, 471 multiplications, 1 square roots
 * outputs: 116 additions, 69 comparisons, 12 divisions, 2 function calls, 94 multiplications, 2 square roots
 */
enum {
    ROAD_CLASS_CHANGE_RATE_OPERATIONS = 350,
    ROAD_CLASS_CHANGE_OUTPUT_OPERATIONS = 295
};

enum { /* states */
    ROAD_CLASS_CHANGE_STATE_z_s = 0, /* z_s */
    ROAD_CLASS_CHANGE_STATE_z_u = 1, /* z_u */
    ROAD_CLASS_CHANGE_STATE_v_s = 2, /* v_s */
    ROAD_CLASS_CHANGE_STATE_v_u = 3, /* v_u */
    ROAD_CLASS_CHANGE_STATE_h_height = 4, /* h.height */
    ROAD_CLASS_CHANGE_STATE_h_slope = 5 /* h.slope */
};
enum { /* parameters */
    ROAD_CLASS_CHANGE_PARAMETER_m_s = 0, /* m_s, sprung mass, kg */
    ROAD_CLASS_CHANGE_PARAMETER_m_u = 1, /* m_u, unsprung mass, kg */
    ROAD_CLASS_CHANGE_PARAMETER_k_s = 2, /* k_s, suspension stiffness, N/m */
    ROAD_CLASS_CHANGE_PARAMETER_c_b = 3, /* c_b, damping in bump (wheel and body approach), N*s/m */
    ROAD_CLASS_CHANGE_PARAMETER_c_r = 4, /* c_r, damping in rebound, N*s/m */
    ROAD_CLASS_CHANGE_PARAMETER_k_t = 5, /* k_t, tyre stiffness, N/m */
    ROAD_CLASS_CHANGE_PARAMETER_G_1 = 6, /* G_1, roughness of class B at 0.1 cycle/m, m^3 */
    ROAD_CLASS_CHANGE_PARAMETER_G_2 = 7, /* G_2, roughness of class D at 0.1 cycle/m, m^3 */
    ROAD_CLASS_CHANGE_PARAMETER_s_1 = 8, /* s_1, where the class changes, m */
    ROAD_CLASS_CHANGE_PARAMETER_s_2 = 9, /* s_2, where the bump begins, m */
    ROAD_CLASS_CHANGE_PARAMETER_b = 10, /* b, length of the bump, m */
    ROAD_CLASS_CHANGE_PARAMETER_H = 11, /* H, height of the bump, m */
    ROAD_CLASS_CHANGE_PARAMETER_V = 12 /* V, speed, m/s */
};
enum { /* outputs */
    ROAD_CLASS_CHANGE_OUTPUT_stroke = 0, /* stroke */
    ROAD_CLASS_CHANGE_OUTPUT_tyre_deflection = 1, /* tyre_deflection */
    ROAD_CLASS_CHANGE_OUTPUT_body_acceleration = 2, /* body_acceleration */
    ROAD_CLASS_CHANGE_OUTPUT_road = 3 /* road */
};
extern const char *const road_class_change_model;
extern const char *const road_class_change_state_names[];
extern const char *const road_class_change_parameter_names[];
extern const char *const road_class_change_output_names[];
extern const road_class_change_real road_class_change_default_parameters[];
extern const road_class_change_real road_class_change_duration;   /* of the model's own run */
extern const int road_class_change_points;          /* output times of that run, both ends */
extern const road_class_change_real road_class_change_start_speed; /* V(0) at the default parameters */

/* Index into y of the covariance of two states. */
int road_class_change_covariance(int i, int j);

/* dy/dt. */
void road_class_change_rate(road_class_change_real t, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT y, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT p, road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT dy);

/* d(dy/dt)/dy: the ROAD_CLASS_CHANGE_NONZEROS values, column by column; entry k stands in row road_class_change_jacobian_row[k], and column j
 * holds the entries from road_class_change_jacobian_column[j] up to, without, road_class_change_jacobian_column[j + 1]. */
void road_class_change_jacobian(road_class_change_real t, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT y, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT p,
                  road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT values);
extern const int road_class_change_jacobian_column[];
extern const int road_class_change_jacobian_row[];

/* The same as a full matrix, ROAD_CLASS_CHANGE_SIZE by ROAD_CLASS_CHANGE_SIZE, column by column. */
void road_class_change_jacobian_dense(road_class_change_real t, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT y, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT p,
                        road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT matrix);

/* d(dy/dt)/dt. */
void road_class_change_slope(road_class_change_real t, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT y, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT p,
               road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT slope);

/* Means and variances of the outputs. */
void road_class_change_outputs(road_class_change_real t, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT y, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT p,
                 road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT mean, road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT variance);

/* Speed, its rate, the distance (0 where it is integrated in y), the distance at the start. */
void road_class_change_motion(road_class_change_real t, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT p, road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT motion);

/* y at t = 0. */
void road_class_change_initial(const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT p, road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT y);

/* Breakpoints of a run: times at which an input changes abruptly and the integration must start anew, increasing.
 * Writes at most `room` of them and returns how many there are. */
int road_class_change_breakpoints(const road_class_change_real *p, road_class_change_real duration, road_class_change_real *times, int room);

/* ---- How a call ended ------------------------------------------------------------------------------------ */

typedef enum {
    ROAD_CLASS_CHANGE_OK = 0,
    ROAD_CLASS_CHANGE_TOO_MANY_STEPS, /* the explicit method on a stiff problem, or a tolerance that is too tight */
    ROAD_CLASS_CHANGE_STEP_TOO_SMALL, /* the moments grow without bound, or the tolerance is below rounding */
    ROAD_CLASS_CHANGE_NOT_FINITE,     /* a rate is not a number: check the parameters and the start */
    ROAD_CLASS_CHANGE_SINGULAR,       /* a linear system has no solution: states, or a combination of them, drift without bound */
    ROAD_CLASS_CHANGE_NO_CONVERGENCE, /* no stationary moments were found from this start */
    ROAD_CLASS_CHANGE_NOT_SEMIDEFINITE /* what was found is not a covariance */
} road_class_change_status;

const char *road_class_change_status_text(road_class_change_status status);

/* ---- Propagation ----------------------------------------------------------------------------------------- */

/* A linear system with the Jacobian, decomposed. */
typedef struct {
    road_class_change_real matrix[ROAD_CLASS_CHANGE_SIZE * ROAD_CLASS_CHANGE_SIZE];
    int pivots[ROAD_CLASS_CHANGE_SIZE];
} road_class_change_factors;

/* Working memory of the stiff method; of no interest otherwise. */
typedef struct {
    road_class_change_real values[ROAD_CLASS_CHANGE_NONZEROS > 0 ? ROAD_CLASS_CHANGE_NONZEROS : 1];
    road_class_change_real stages[6][ROAD_CLASS_CHANGE_SIZE];
    road_class_change_real slope[ROAD_CLASS_CHANGE_SIZE];
    road_class_change_real diagonal[ROAD_CLASS_CHANGE_SIZE];
    road_class_change_factors factors;
} road_class_change_stiff;

/* A run in progress. Set up with road_class_change_begin; the fields up to the blank line may then be changed. */
typedef struct {
    road_class_change_real rtol;         /* relative error of a step (default 1e-6) */
    road_class_change_real floor;        /* what counts as zero, over a moment's own size (default 1e-4) */
    road_class_change_real longest_step; /* default: no bound */
    long most_steps;       /* of one call (default 1000000) */
    road_class_change_stiff *stiff;      /* 0: explicit (Dormand & Prince 5(4)); else Rosenbrock (Rodas 4(3)), with this memory */
    const road_class_change_real *breakpoints; /* increasing; 0: none */
    int breakpoint_count;

    road_class_change_real t;
    road_class_change_real y[ROAD_CLASS_CHANGE_SIZE];
    road_class_change_real step; /* to be tried next */
    long steps, refused, rates;
    road_class_change_real size[ROAD_CLASS_CHANGE_SIZE];
    road_class_change_real stages[7][ROAD_CLASS_CHANGE_SIZE];
    road_class_change_real trial[ROAD_CLASS_CHANGE_SIZE];
    int settled; /* moments of the ground's filters that stay as they are */
    int fresh; /* stages[0] holds the rate at (t, y) */
} road_class_change_run;

void road_class_change_begin(road_class_change_run *run, road_class_change_real t, const road_class_change_real *y);

/* Integrate to a later time. On failure `run` holds what was reached. */
road_class_change_status road_class_change_propagate(road_class_change_run *run, const road_class_change_real *p, road_class_change_real until);

/* Fixed steps for real time: one step of the classical Runge-Kutta method, 4 rates. `work` has room for
 * 5 * ROAD_CLASS_CHANGE_SIZE values. The cost is the same for all data: ROAD_CLASS_CHANGE_STEP_OPERATIONS operations. */
void road_class_change_fixed_step(road_class_change_real t, road_class_change_real step, road_class_change_real *y, const road_class_change_real *p, road_class_change_real *work);
enum { ROAD_CLASS_CHANGE_STEP_OPERATIONS = 4 * ROAD_CLASS_CHANGE_RATE_OPERATIONS + 13 * ROAD_CLASS_CHANGE_SIZE + 4 };

/* ---- Stationary moments ---------------------------------------------------------------------------------- */

typedef struct {
    road_class_change_real values[ROAD_CLASS_CHANGE_NONZEROS > 0 ? ROAD_CLASS_CHANGE_NONZEROS : 1];
    road_class_change_real second[ROAD_CLASS_CHANGE_SIZE * ROAD_CLASS_CHANGE_SIZE];
    road_class_change_real third[ROAD_CLASS_CHANGE_SIZE * ROAD_CLASS_CHANGE_SIZE];
    road_class_change_real vectors[11][ROAD_CLASS_CHANGE_SIZE];
    road_class_change_factors factors;
    int left_out[ROAD_CLASS_CHANGE_SIZE];
} road_class_change_stationary_work;

typedef struct {
    road_class_change_real speed;    /* held constant; of no meaning without ground */
    road_class_change_real t, s;     /* instant and place at which explicit dependence is frozen (default 0) */
    int most_steps;    /* of each method (default 200) */
    road_class_change_real residual; /* of the moment equations over the size of their own terms */
    int steps;
    int stable;        /* as a fixed point of the moment equations */
    int drifting[ROAD_CLASS_CHANGE_STATES]; /* 1: the state has no stationary moments, and nothing depends on it; its moments are NaN */
    road_class_change_stationary_work *work;
} road_class_change_stationary_problem;

void road_class_change_stationary_begin(road_class_change_stationary_problem *problem, road_class_change_real speed, road_class_change_stationary_work *work);

/* 1: rates depend on t or s, so that nothing is stationary but with both frozen. */
enum { ROAD_CLASS_CHANGE_EXPLICIT = 1 };

/* Stationary moments near y (Newton, then pseudo-transient continuation); with all of y zero, from next to none. */
road_class_change_status road_class_change_stationary(road_class_change_stationary_problem *problem, const road_class_change_real *p, road_class_change_real *y);

/* y at t = 0, stationary where the model starts so (`work` is needed then only; 0 else). */
enum { ROAD_CLASS_CHANGE_STEADY_START = 0 };
road_class_change_status road_class_change_start(const road_class_change_real *p, road_class_change_stationary_work *work, road_class_change_real *y);

/* The rate, its Jacobian (pattern as above) and the outputs at a speed held constant. */
void road_class_change_held_rate(road_class_change_real t, road_class_change_real s, road_class_change_real V, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT y,
                   const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT p, road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT dy);
void road_class_change_held_jacobian(road_class_change_real t, road_class_change_real s, road_class_change_real V, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT y,
                       const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT p, road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT values);
void road_class_change_held_outputs(road_class_change_real t, road_class_change_real s, road_class_change_real V, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT y,
                      const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT p, road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT mean,
                      road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT variance);

/* ---- Parts of the above ---------------------------------------------------------------------------------- */

/* Functions of t and s whose sign changes at a breakpoint. */
void road_class_change_switches(road_class_change_real t, road_class_change_real s, const road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT p, road_class_change_real *ROAD_CLASS_CHANGE_RESTRICT values);
/* 1 if the distance is integrated in y, at index ROAD_CLASS_CHANGE_MOMENTS; else it is known in closed form. */
enum { ROAD_CLASS_CHANGE_DISTANCE = 0 };

/* LU decomposition with pivoting, in place, of a full matrix (column by column); 0 if it is singular. */
int road_class_change_decompose(int n, road_class_change_real *matrix, int *pivots);
void road_class_change_solve(int n, const road_class_change_real *matrix, const int *pivots, road_class_change_real *x);
/* factor * Jacobian + a diagonal matrix, decomposed; 0 if it is singular. x becomes the solution for x. */
int road_class_change_factorise(const road_class_change_real *values, road_class_change_real factor, const road_class_change_real *diagonal, road_class_change_factors *factors);
void road_class_change_backsolve(const road_class_change_factors *factors, road_class_change_real *x);
/* Add factor * Jacobian to a full matrix. */
void road_class_change_add_jacobian(const road_class_change_real *values, road_class_change_real factor, road_class_change_real *matrix);

#ifdef __cplusplus
}
#endif
#endif
