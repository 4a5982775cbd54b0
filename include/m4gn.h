/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * C ABI of libm4gn.so: everything a solver needs to be a host of M4GN.
 *
 * Only sized arrays of double, int32_t and int64_t cross this boundary. Vectors are always three doubles
 * (x, y, z), row after row, whatever the number of solved directions. Lengths in metres, times in seconds.
 * Pointers passed in are read during the call and never kept.
 *
 * Status: 0 fine; > 0 the call failed and the object is as it was (bad input, file); < 0 the object must only
 * be freed. m4gn_last_error() then says what was expected, what was found, where, and what to do.
 * Calls marked "collective" are made by every rank of the communicator; they return the same class of
 * status on all ranks, so that no rank waits for another that has left. All settings must be the same on all ranks,
 * the file's name of a path included, but not what belongs to a rank alone: its arrays, threads and device. A rank that
 * breaks (a defect of this library) makes the call fail with M4GN_ERROR_INTERNAL on all; where another one waits inside
 * a library and cannot be told, the job is ended after 10 s with a message. Only what names the communicator cannot be
 * agreed upon: comm, and the handle of an object, must be valid on every rank.
 *
 * Every call saves, clears and restores the floating-point traps, so that a host that traps (OpenFOAM's
 * FOAM_SIGFPE) is neither disturbed nor disturbs. MPI and PETSc are joined if they are up.
 */
#ifndef M4GN_H
#define M4GN_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define M4GN_ABI_VERSION 14

/* Pass instead of MPI_Comm_c2f(comm) where the host runs without MPI. */
#define M4GN_NO_MPI INT32_MIN

enum
{
    M4GN_OK = 0,
    M4GN_ERROR_INPUT = 1,
    M4GN_ERROR_FILE = 2,
    M4GN_ERROR_MODEL = 3,
    M4GN_ERROR_MESH = 4,
    M4GN_ERROR_NUMERICAL = 5,
    M4GN_ERROR_INTERRUPTED = 6,
    M4GN_ERROR_OTHER_RANK = 7,
    M4GN_ERROR_INTERNAL = -1
};

/* Node types of the graph (paper, table 2); M4GN_FLUID is every cell, of a solid too. */
enum
{
    M4GN_FLUID = 0,
    M4GN_WALL = 1,
    M4GN_INLET = 2,
    M4GN_OUTLET = 3,
    M4GN_SYMMETRY = 4,
    M4GN_OBSTACLE = 5,
    M4GN_BODY = 6,   /* a point of a body */
    M4GN_HANDLE = 7, /* of a body: the displacement is prescribed */
    M4GN_FREE = 8    /* of a body: a free or loaded surface */
};

/* Version of this interface that the library was built with; compare with M4GN_ABI_VERSION. */
int32_t m4gn_abi_version(void);

/* Version of the library, "0.1.0". */
const char* m4gn_version(void);

/* Message of the last failed call on this thread; empty when there was none. Valid until the next call. */
const char* m4gn_last_error(void);

/* Collective. Ends MPI and PETSc if this library started them, which is done at the end of the process anyway: for hosts
 * without MPI that must see it ended earlier. Nothing that needs them can be done afterwards. */
void m4gn_finalize(void);

/* ---- settings ----------------------------------------------------------------------------------- */

/* What is words and numbers is given to a call as its settings: the text of a JSON object, or NULL for {}. What is not given
 * has its default. The names are those of a case dictionary (docs/dictionary.md), as distance_scale or as distanceScale. A
 * name that is not known and a value of another type or out of range are M4GN_ERROR_INPUT, with a message that names the
 * entry, what was expected and what was found.
 *
 * segments: how the mesh is cut, an object of what differs from the model's segmentation (m4gn_session_new; m4gn_segments_new
 * with a model), or from the defaults:
 *
 *   name            default     meaning
 *   method          "slic-md"   "metis", "slic-md", "slic-mdodl", "slic-mdode"
 *   count           36          number of segments K
 *   modes           6           number of modes m
 *   operator        null        "laplacian" or "elastic"; null: elastic where the mesh has such modes
 *   tau             1.0         weight of positions against modes
 *   size            null        size S of a segment, m; null: from K
 *   iterations      20          most sweeps of SLIC, up to 10000
 *   connected       true        every segment is connected
 *   distance_scale  null        length of the distance to the obstacle, m; 0: off (the paper); null: S
 *   scaled_modes    true        a mode enters as S times itself; false: as it is (the paper)
 *   margin          1e-5        by how much of S a centroid must be nearer to take a cell away; 0: the paper
 *   obstacles       []          names of the patches that are the obstacle; []: found by their node types
 *   overlap         0           layers by which segments overlap
 *   modal_solver    "auto"      "auto" (by size), "direct" or "iterative"
 */

/* Whether settings are valid, as far as can be said without a mesh, a model and other ranks: those of m4gn_session_new
 * (kind "session"), m4gn_segments_new ("segments"), m4gn_modes_new ("modes"), m4gn_solid_modes_new ("solid_modes"),
 * m4gn_recorder_new ("recorder") or m4gn_ride_new ("ride"). */
int32_t m4gn_options_check(const char* kind, const char* options);

/* ---- mesh and fields ---------------------------------------------------------------------------- */

/* This rank's part of the mesh. Local labels; `empty` patches contribute nothing. A solver with its unknowns at points hands
 * in points for cells, edges for faces, and a boundary face at each point of a patch (openfoam/adapter/m4gnPointAdapter.H). */
typedef struct m4gn_mesh_data
{
    int32_t n_directions;  /* 2 or 3 solved directions */
    int32_t directions[3]; /* which: 0 x, 1 y, 2 z */

    int32_t n_cells;
    const int64_t* cell_global; /* [n_cells] number of the cell in the undecomposed mesh, 0-based; a
                                   permutation of 0..N over all ranks */
    const double* cell_centres; /* [3*n_cells] m */
    const double* cell_volumes; /* [n_cells] m^3 */

    int32_t n_faces;               /* internal faces of this rank */
    const int32_t* face_owner;     /* [n_faces] */
    const int32_t* face_neighbour; /* [n_faces] */
    const double*
        face_coeff; /* [n_faces] |off-diagonal| of the solver's Laplacian with unit diffusivity, m */

    int32_t n_boundary;             /* faces of patches that carry values (neither empty nor coupled) */
    const int32_t* boundary_owner;  /* [n_boundary] cell */
    const int64_t* boundary_global; /* [n_boundary] number among all such faces in the undecomposed mesh;
                                        a permutation of 0..B over all ranks */
    const double* boundary_centres; /* [3*n_boundary] m */
    const double* boundary_area;    /* [3*n_boundary] outward area vector, m^2 */
    const double* boundary_coeff;   /* [n_boundary] diagonal contribution of a Dirichlet condition, m */
    const int32_t* boundary_type;   /* [n_boundary] M4GN_WALL ... M4GN_FREE */
    const int32_t* boundary_patch;  /* [n_boundary] index into patch_names */

    int32_t n_coupled;             /* faces of processor and translational cyclic patches, one entry a side */
    const int32_t* coupled_owner;  /* [n_coupled] cell on this side */
    const int32_t* coupled_rank;   /* [n_coupled] rank of the cell on the other side */
    const int64_t* coupled_global; /* [n_coupled] cell_global of the cell on the other side */
    const double*
        coupled_delta; /* [3*n_coupled] from this cell's centre to the other's through the coupling, m */
    const double* coupled_coeff; /* [n_coupled] as face_coeff */

    int32_t n_patches;
    const char* const* patch_names; /* [n_patches] */

    int32_t n_modes; /* modes of the elastic body (m4gn_solid_modes_new), of which segments are then made;
                                   0: none are given */
    const double*
        mode_eigenvalues; /* [n_modes] 1/s^2, ascending; a repeated one whole; the same on all ranks */
    const double*
        mode_cells; /* [3*n_cells*n_modes] mode after mode, the displacement of each cell: the mean of its
                                   points' */

    /* A body that deforms, by its points. cell_type says so: the cells are then the body's points, cell_centres their
     * positions at rest; cell_volumes is not read; n_faces, n_boundary and n_coupled are 0, for edges and volumes follow
     * from the elements. NULL on all ranks: the cells of a mesh that does not move. */
    const int32_t*
        cell_type;      /* [n_cells] M4GN_BODY (free) or M4GN_HANDLE (held); not NULL even without cells */
    int32_t n_elements; /* elements of this rank; each element of the body is one rank's */
    const int32_t*
        element_kind; /* [n_elements] VTK's codes: 10 tetrahedron, 12 hexahedron, 13 wedge, 14 pyramid */
    const int64_t* element_points;  /* cell_global of the elements' points, element after element */
    const double* element_material; /* [3*n_elements] Young's modulus Pa, Poisson's ratio, density kg/m^3 */
    int32_t n_obstacle; /* points of a rigid obstacle, whole and the same on all ranks; 0: there is none */
    const double* obstacle_positions; /* [3*n_obstacle] where its displacement is 0, m */
    int32_t n_obstacle_triangles;
    const int32_t*
        obstacle_triangles; /* [3*n_obstacle_triangles] points of its closed surface, normals outward */
} m4gn_mesh_data;

/* A field at one time, on this rank. */
typedef struct m4gn_field
{
    const char* name;    /* OpenFOAM's name, "U" */
    int32_t components;  /* 1 scalar, 3 vector */
    const double* cells; /* [components*n_cells] */
    const double*
        boundary; /* [components*n_boundary] face values; of a body, and read by the frames of a ride alone, the
                                   displacement of the obstacle's points [3*n_obstacle], of which the first rank's counts */
} m4gn_field;

/* Where a predicted field goes; components that are not solved are left as they are. */
typedef struct m4gn_field_out
{
    const char* name;
    int32_t components;
    double* cells; /* [components*n_cells] */
} m4gn_field_out;

/* ---- surrogate ---------------------------------------------------------------------------------- */

/* A model as it was when its file was read: segments and sessions that are made of it are of one model, whatever happens to the
 * file meanwhile. Free it when nothing more is to be made of it; a session keeps what it needs. */
typedef struct m4gn_model m4gn_model;

/* Collective. The first rank reads the file and hands it to all. On failure *model is NULL; M4GN_ERROR_FILE for what is no model:
 * a folder, a pipe, a header that does not fit the file. */
int32_t m4gn_model_open(int32_t comm, const char* path, m4gn_model** model);

/* NULL is none. */
void m4gn_model_free(m4gn_model* model);

/* How many modes of the elastic body the mesh must have for this model's segments; 0: none, they are of the Laplacian's or of no
 * modes. Negative after an error. */
int32_t m4gn_model_elastic_modes(const m4gn_model* model);

typedef struct m4gn_session m4gn_session;

/* Collective. Builds graph, modes and segments for a model, the same on all ranks. On failure *session is NULL. The settings are
 *
 *   name            default     meaning
 *   backend         "native"    "native", "torch", or "torch:DEVICE", e.g. "torch:cuda:0"
 *   n_threads       1           threads of this rank
 *   precision       "fp32"      of the native backend's products: "fp32", "bf16", "auto" (the faster), or "model" ("auto" for a model
 *                               of fields at cells that was trained in bf16, else "fp32")
 *   resolution      "auto"      of fields at cells: mean distance of the network's nodes, "auto" for what the model was trained
 *                               on, "off" for a node a cell, or a length, m
 *   segments        {}          what differs from the segmentation that the model was trained with, see above
 *   solid           null        what the solver says of a solid at cells, for m4gn_session_outside, each entry optional: {"E":
 *                               [lowest, highest], "nu": [0.3, 0.3], "rho": ..., "traction": ..., "laws": ["linearElastic"],
 *                               "schemes": ["Euler"]}: Pa, kg/m^3; the largest traction on a face, Pa
 */
int32_t m4gn_session_new(
    int32_t comm, /* MPI_Comm_c2f of the host's communicator, or M4GN_NO_MPI; duplicated */
    const m4gn_mesh_data* mesh, const m4gn_model* model, const char* options,
    const int32_t* cell_segment, /* [n_cells] segments computed before (m4gnSegment); NULL: compute */
    m4gn_session** session);

/* Collective. */
void m4gn_session_free(m4gn_session* session);

/* Time that one step advances, s. */
double m4gn_session_stride(const m4gn_session* session);

/* Segments K of this session. */
int32_t m4gn_session_n_segments(const m4gn_session* session);

/* Fields of the model, in its order; index 0 to n-1. */
int32_t m4gn_session_n_fields(const m4gn_session* session);

typedef struct m4gn_field_info
{
    const char* name;      /* valid while the session lives */
    int32_t components;    /* 1 or 3 */
    int32_t dimensions[7]; /* dimensionSet exponents */
    int32_t is_input;
    int32_t is_output;
} m4gn_field_info;

int32_t m4gn_session_field(const m4gn_session* session, int32_t index, m4gn_field_info* info);

/* Segment of each cell [n_cells], 0 to K-1. */
int32_t m4gn_session_segments(const m4gn_session* session, int32_t* cell_segment);

/* Groups of cells that the network lives on, of all ranks; 0: it lives on the cells themselves. */
int32_t m4gn_session_n_groups(const m4gn_session* session);

/* Group of each cell [n_cells], 0 to n_groups-1; the same on any number of ranks. M4GN_ERROR_INPUT where there are none. */
int32_t m4gn_session_groups(const m4gn_session* session, int32_t* cell_group);

/* How the segments were computed, to be stored with them; "" if they were handed in. Valid while the session lives. */
const char* m4gn_session_segment_record(const m4gn_session* session);

/* Collective. One step: reads every input field (cells and boundary values at time t), writes every output
 * field's cells at t + stride. `in` and `out` may name the same arrays. A non-finite result is an error
 * (M4GN_ERROR_NUMERICAL) and leaves `out` untouched. */
int32_t m4gn_session_step(
    m4gn_session* session, const m4gn_field* in, int32_t n_in, const m4gn_field_out* out, int32_t n_out);

/* Collective. Displacement of the obstacle's points [3*n_obstacle] at the start and at the end of the next step, m; to be
 * given before every step of a body that has an obstacle. That of the first rank counts. */
int32_t m4gn_session_set_obstacle(
    m4gn_session* session, const double* now, const double* after, int32_t n_obstacle);

/* Collective. In how many respects the case lies outside of what the model was trained on: cell size, speed, Courant number
 * of the stride and inputs by more than a quarter of their range, a solid's moduli and largest traction by more than 2 %, its
 * laws and schemes by name. What a solid at cells is, the host says in the options (solid); a body at points says Poisson's
 * ratio with its elements. Before the first step there are no fields to look at: cell size and solid alone. One a line in why,
 * ended by a zero byte. 0 for a model that does not say what it was trained on. */
int32_t m4gn_session_outside(
    const m4gn_session* session, int32_t* count, char* why, /* [why_size] */
    int32_t why_size);

/* ---- ride --------------------------------------------------------------------------------------- */

/* A hybrid run: the host's solver works, surrogates are measured beside it, the nearest one takes its place for a jump of some strides,
 * and hands back. The ride knows no solver: it is told what happened and answers what to do next.
 *
 *     answer of:            action                     the host
 *     m4gn_ride_handed_back M4GN_RIDE_SOLVE            lets its solver make a step, and calls m4gn_ride_solved
 *     m4gn_ride_solved      M4GN_RIDE_DECIDE           saves the state where it writes its own, and calls m4gn_ride_decide
 *     m4gn_ride_decide      SOLVE or STRIDE            on M4GN_RIDE_STRIDE calls m4gn_ride_stride
 *     m4gn_ride_stride      ADVANCE, HAND_BACK, SOLVE  on M4GN_RIDE_ADVANCE advances its time by `duration` and its fields to the
 *                                                      prediction, and calls m4gn_ride_advanced
 *     m4gn_ride_advanced    STRIDE or HAND_BACK        saves the state where it writes its own; on M4GN_RIDE_HAND_BACK leaves the
 *                                                      fields as its solver needs them, and calls m4gn_ride_handed_back
 *
 * A call that is not due is M4GN_ERROR_INPUT. Figures of the host are the same on all ranks but for `wall`. examples/hybrid_host is
 * such a host. */
typedef struct m4gn_ride m4gn_ride;

enum
{
    M4GN_RIDE_SOLVE = 0,
    M4GN_RIDE_DECIDE = 1,
    M4GN_RIDE_STRIDE = 2,
    M4GN_RIDE_ADVANCE = 3,
    M4GN_RIDE_HAND_BACK = 4
};

/* Where the host is. */
typedef struct m4gn_ride_step
{
    double time;     /* s */
    double delta_t;  /* of the solver, s; not read within a jump */
    double end_time; /* of the run, s; HUGE_VAL: none */
    double shown;    /* the time as tables have it */
    double wall;     /* wall time of the run so far, s; 0: not known */
    int64_t
        index; /* number of the solver's time step, in which a stride counts as the steps that it stands for */
    const char* name;        /* of the time, in messages; NULL: its value */
    int32_t correctors;      /* that the solver took in this step; -1: it has none */
    int32_t most_correctors; /* its cap of them; -1: it has none */
} m4gn_ride_step;

typedef struct m4gn_ride_answer
{
    double duration;      /* of ADVANCE: time by which the stride advances, s; of STRIDE: the length of one */
    double delta_t;       /* within a jump the solver's time step, s; else 0 */
    int64_t solver_steps; /* of ADVANCE: time steps of the solver that it stands for */
    int64_t since;        /* time steps since the last jump; -1: there was none */
    int32_t action;       /* M4GN_RIDE_SOLVE ... */
    int32_t surrogate;    /* which one jumps, in the order of the setting surrogates */
    int32_t
        strides; /* of the jump that are left; of HAND_BACK those that a run takes which is carried on: this one
                                   was stopped in the jump */
    int32_t last_but_one; /* 1: one stride is left, whose state is handed back */
    int32_t fields;       /* 1: the next call needs the fields; 0: it may be given none */
    int32_t stepped;      /* 1: the model has taken a stride, beside the solver or in its place */
    int32_t arrays;       /* 1: m4gn_ride_record is to be called before the next call */
} m4gn_ride_answer;

/* What a host tells of a jump, for the log and the table. */
typedef struct m4gn_ride_quantity
{
    const char* name;
    double value;
} m4gn_ride_quantity;

/* A surrogate of the host's own: a table, another library. */
typedef struct m4gn_surrogate
{
    const char* name;                /* in messages and tables */
    double stride;                   /* time that a step advances, s */
    int32_t n_fields;                /* fields that it advances */
    const char* const* field_names;  /* [n_fields] */
    const int32_t* field_components; /* [n_fields] 1 or 3 */
    /* One step from the fields `in`, those of the call of the ride: `out` holds the advanced fields at the start, and is to hold
     * them at its end. A status; M4GN_ERROR_NUMERICAL where there is no result. All ranks are called. */
    int32_t (*step)(void* data, const m4gn_field* in, int32_t n_in, const m4gn_field_out* out, int32_t n_out);
    void* data; /* kept until the ride is freed, and handed to step */
} m4gn_surrogate;

/* An array of a solver's state on this rank. The linear surrogate hands back one combination of the run's states for all of them: what is
 * linear in the arrays (continuity of face fluxes, fixed values) is kept to rounding. */
typedef struct m4gn_ride_array
{
    const char* name;   /* unique; of a field the name that it has in m4gn_ride_stride */
    int64_t n;          /* numbers: items times components, those of an item together */
    int32_t components; /* numbers an item */
    int32_t
        solved; /* components that are solved of a field at cells or points, 1 to components: it is measured, and advanced; 0: the
                                   array is carried along (fluxes, boundary values) */
    int32_t positive; /* not 0: predictions are not below the least value of the run's states */
    int32_t
        fitted; /* not 0, of a field that is solved: the fit is made of it, as of all fields with an equation in time;
                                   0: it is carried along and measured (an incompressible pressure, with the noise of its tolerance) */
    int32_t input; /* not 0: a value that is prescribed; m4gn_ride_inputs says what it will be */
    const double*
        weights; /* [n/components] volumes of the cells, or the points' shares of them, where the fit is made of it, else NULL */
} m4gn_ride_array;

/* What may take the solver's place: that which the setting surrogates names. */
typedef struct m4gn_ride_surrogates
{
    m4gn_session*
        session; /* "network": its model. It must live as long as the ride, and the host may go on using it between calls */
    const m4gn_surrogate* own; /* or one of the host's own in its place, without adapt */
    const m4gn_ride_array*
        arrays; /* "linear": the state that is fitted (higher-order dynamic mode decomposition) */
    int32_t n_arrays;
} m4gn_ride_surrogates;

/* Collective. Begins a ride at the present time, `start`. Fields of calls below are all fields of the surrogates by name, inputs and
 * outputs of the model, and arrays that are measured; boundary values are read of the former only, and may be NULL of the others. Of a
 * body with an obstacle, m4gn_session_set_obstacle comes before each call that is given fields. On failure *ride is NULL. The settings are
 *
 *   name            default     meaning
 *   mode                        "replace", or "observe": the surrogates are compared with the solver, which runs as without them; must
 *                               be given
 *   surrogates      ["network"] or ["linear"], or both
 *   name            ""          of the ride, in messages
 *   solver_steps                steps of the solver before each jump; must be given in mode replace, with linear 1
 *   surrogate_steps             strides of a jump, with control at most; must be given in mode replace, with linear `longest`
 *   rollout_steps   50          mode observe: strides after which a rollout begins anew
 *   write_errors    false       mode observe: errors in each segment and at each cell
 *   time_start      null        the solver is alone before, s; null: from the start
 *   time_end        null        and after, s; null: to the end
 *   control         null        how far a jump may go (docs/control.md): {"tolerance": 0.05} suffices, and is there with linear in mode
 *                               replace; others: rel_tol (0.2), fields (["U"]; the first predicted one, of several surrogates the first
 *                               that all predict), on_failure ("solver", or "stop"), patience (10)
 *   linear          {}          how the linear surrogate is fitted, see below
 *   quantities      []          mode replace: results of other parts of the run, and how far off they may be at the end of a jump:
 *                               [{"object": "forces", "result": "Cd", "tolerance": 0.01}] (docs/control.md)
 *   adapt           null        the model learns the case (docs/adaptation.md): {"mode": "before"}; start: time of the first frame, s
 *                               (a third of the time before time_start); writeModel: path of the adapted model, false
 *   write_precision 6           significant digits of tables and messages
 *   model           ""          where the model is from, in messages and tables
 *   host            ""          any text that the host keeps in the state for itself, of the first rank (m4gn_ride_host)
 *   setup_seconds   0           wall time that making the session took, s: for the summary
 *
 * and those of linear
 *
 *   interval        null        time between states, the stride, s; null: 25 time steps
 *   tolerance       0.025       most that a fit may be off on the held-back end of its window, and in a stride after a jump, over what
 *                               holding would be off by
 *   enough          0.005       error below which a fit is used at once; above it when three later tries are hardly better
 *   first           10          strides of the first jump of a fit
 *   growth          1.5         how much longer the next may be
 *   longest         200         strides of a jump at most
 *   every           5           strides of the solver between tries of a fit
 *   window          40          states in a fit at most
 *   least           40          states without a gap that it needs
 *   tail            5           states that are held back
 *   delays          [5, 8, 12]  delays to choose from
 *   ranks           [12, 30]    ranks to choose from
 *   growing         null        whether modes may grow; null: the held-back states say
 *   storage         "double"    or "single": how states are kept; sums are double with both
 *   file            null        where states are kept for a restart, a file a rank; null: they are not
 */
int32_t m4gn_ride_new(
    int32_t
        comm, /* MPI_Comm_c2f of the host's communicator, or M4GN_NO_MPI; duplicated. Not read with a session */
    const m4gn_ride_surrogates* surrogates,
    const m4gn_mesh_data* mesh, /* of the session; NULL with linear alone */
    const char* options, const m4gn_ride_step* start, m4gn_ride** ride);

/* Collective. The arrays of the state after a step of the solver, where the last answer asks for them: after m4gn_ride_solved. */
int32_t m4gn_ride_record(m4gn_ride* ride, const double* const* arrays, int32_t n_arrays);

/* Values of all arrays that are inputs, in their order, at the end of the next stride: after the answer M4GN_RIDE_STRIDE, whose duration says
 * how long that one is. A stride whose prediction is off from them is not taken. */
int32_t m4gn_ride_inputs(m4gn_ride* ride, const double* const* arrays, int32_t n_arrays);

/* The arrays of the state that the last stride of a jump predicted, until it is handed back; before (s) > 0: after
 * m4gn_ride_advanced those of a state so long before it, where the solver's time scheme has an old level. No two places may overlap. */
int32_t m4gn_ride_arrays(const m4gn_ride* ride, double before, double* const* arrays, int32_t n_arrays);

/* Collective. */
void m4gn_ride_free(m4gn_ride* ride);

/* The solver has made a step. M4GN_ERROR_INPUT too where strides would be compared at times at which none ends, since the ride is
 * not told of each step. */
int32_t m4gn_ride_solved(m4gn_ride* ride, const m4gn_ride_step* now, m4gn_ride_answer* answer);

/* Collective. What follows that step. M4GN_ERROR_NUMERICAL where the model stays bad and control says stop. */
int32_t m4gn_ride_decide(
    m4gn_ride* ride,
    const m4gn_field* fields, /* after the step; may be NULL where the last answer does not ask for them */
    const int32_t* const*
        held, /* mode observe: [n_fields], of each field [n_boundary] not 0 where a boundary face holds its value and
                                   0 where it follows its cell; NULL, or NULL of a field: all hold */
    int32_t n_fields, m4gn_ride_answer* answer);

/* Collective. A stride from the present fields. `out` has the predicted fields in the session's order, and is written where the
 * action is M4GN_RIDE_ADVANCE. It may name the same arrays. */
int32_t m4gn_ride_stride(
    m4gn_ride* ride, const m4gn_field* fields, int32_t n_fields, const m4gn_field_out* out, int32_t n_out,
    m4gn_ride_answer* answer);

/* Time and fields are those of the prediction. */
int32_t m4gn_ride_advanced(m4gn_ride* ride, const m4gn_ride_step* now, m4gn_ride_answer* answer);

/* With the setting quantities: what they are after the present state, in their order, NAN where there is none. Behind m4gn_ride_decide,
 * and after m4gn_ride_advanced. The same on all ranks. */
int32_t m4gn_ride_reported(m4gn_ride* ride, const double* values, int32_t n_values);

/* Wall time since the last such call that went into strides and into handing over, s. */
int32_t m4gn_ride_spent(m4gn_ride* ride, double surrogate, double hand_over);

/* Collective. The solver goes on from this state. Fields as for m4gn_ride_decide. */
int32_t m4gn_ride_handed_back(
    m4gn_ride* ride, const m4gn_ride_step* now, const m4gn_ride_quantity* quantities, int32_t n_quantities,
    const m4gn_field* fields, int32_t n_fields, m4gn_ride_answer* answer);

/* Collective. One file, which the first rank writes and reads: a ride that takes it up, on a host that has the fields of that time, goes
 * on as the uninterrupted one. To be saved where the table above says so. The action of load is M4GN_RIDE_DECIDE, M4GN_RIDE_STRIDE
 * where strides of a jump are left, or M4GN_RIDE_HAND_BACK where the state is one that was handed back already. On another number of
 * ranks it works as well. M4GN_ERROR_FILE for a file that is damaged (it has a checksum) or of another mesh or time,
 * M4GN_ERROR_MODEL for one of another model: the ride then begins anew. */
int32_t m4gn_ride_save(m4gn_ride* ride, const char* path);
int32_t m4gn_ride_load(
    m4gn_ride* ride, const char* path, const m4gn_ride_step* now, m4gn_ride_answer* answer);

/* Not collective. As much as fits of the text that the host keeps in a state, ended by a zero byte: to be read before a ride is made. */
int32_t m4gn_ride_host(const char* path, char* text, int32_t size);

enum
{
    M4GN_RIDE_LOG = 0,            /* lines of the log */
    M4GN_RIDE_WARNING = 1,        /* one warning */
    M4GN_RIDE_JUMPS = 2,          /* rows of the table of jumps */
    M4GN_RIDE_STRIDES = 3,        /* rows of the table of strides beside the solver */
    M4GN_RIDE_ERRORS = 4,         /* mode observe: rows of the table of errors */
    M4GN_RIDE_SEGMENT_ERRORS = 5, /* and of that of errors in segments */
    M4GN_RIDE_SUMMARY =
        6, /* ends the ride: totals go into the log, and in mode replace into this JSON object */
    M4GN_RIDE_DIFFERENCE_TIME = 7 /* name of the time of m4gn_ride_difference */
};

/* Takes what there is to be said, "" if there is nothing. A table's first rows come with its head. Valid until the next call. */
const char* m4gn_ride_text(m4gn_ride* ride, int32_t kind);

/* Mode observe with write_errors: rollout of a surrogate minus solver at the cells of a field that it advances, [components*n_cells],
 * where they were compared last. M4GN_ERROR_INPUT before. */
int32_t m4gn_ride_difference(const m4gn_ride* ride, int32_t surrogate, int32_t index, double* cells);

/* ---- segments ----------------------------------------------------------------------------------- */

/* Segments of a mesh without a model, and its Laplacian modes. */
typedef struct m4gn_segments m4gn_segments;

/* Collective. Cuts the mesh; on failure *segments is NULL. The settings are
 *
 *   name            default     meaning
 *   segments        {}          what differs from the model's segmentation, or from the default, see above
 *   with_modes      false       compute and keep the modes; if false, m4gn_segments_n_modes is 0, and with cell_segment
 *                               nothing is solved
 */
int32_t m4gn_segments_new(
    int32_t comm, const m4gn_mesh_data* mesh,
    const m4gn_model* model, /* whose segmentation is meant; NULL: the default one */
    const char* options,
    const int32_t* cell_segment, /* [n_cells] segments computed before (m4gnSegment); NULL: compute */
    m4gn_segments** segments);

void m4gn_segments_free(m4gn_segments* segments);

/* How they were computed, to be stored with them; "" if they were handed in. Valid while the segments live. */
const char* m4gn_segments_record(const m4gn_segments* segments);

/* Collective. Whether cell_segment, which was stored, is what the settings describe on this mesh, as far as the record that
 * was stored with it says: the model's segmentation with the entries of segments, or without a model those entries alone.
 * *fit is 1, or 0 and why, ended by a zero byte, says what differs. A model without segments takes any. */
int32_t m4gn_segments_fit(
    int32_t comm, const m4gn_mesh_data* mesh,
    const m4gn_model* model,                          /* as of m4gn_segments_new, and so the options */
    const char* options, const int32_t* cell_segment, /* [n_cells]; not NULL */
    const char* record,      /* from m4gn_segments_record; NULL or "": none was stored. Rank 0's counts */
    int32_t* fit, char* why, /* [why_size] */
    int32_t why_size);

/* Segments K. */
int32_t m4gn_segments_count(const m4gn_segments* segments);

/* Segment of each of this rank's cells [n_cells], 0 to K-1. */
int32_t m4gn_segments_cells(const m4gn_segments* segments, int32_t* cell_segment);

/* Over all ranks: nodes (cells and boundary faces) of each segment [K], and edges from one segment to another [K*K];
 * two segments that share n faces have n edges each way. */
int32_t m4gn_segments_graph(const m4gn_segments* segments, double* sizes, double* adjacency);

/* Modes: as many as spec says, more if the last eigenvalue is repeated. */
int32_t m4gn_segments_n_modes(const m4gn_segments* segments);

/* Mode index (0 to n-1, by ascending eigenvalue): eigenvalue, 1/m^2, and the mode in this rank's cells [n_cells],
 * scaled to sum V phi^2 = sum V. Of an elastic body the solved components of each of its modes follow each other,
 * each with the eigenvalue, 1/s^2. */
int32_t m4gn_segments_mode(const m4gn_segments* segments, int32_t index, double* eigenvalue, double* cells);

typedef struct m4gn_rank_report
{
    double cut;       /* faces between segments of different ranks */
    double imbalance; /* largest load over its rank's share; 1: perfect */
} m4gn_rank_report;

/* Not collective; a function of its arguments alone. The rank of each segment, so that every rank has at least one,
 * loads are balanced and few faces lie between ranks. n_segments < n_ranks is an error. */
int32_t m4gn_segment_ranks(
    int32_t n_segments, const double* sizes,     /* [n_segments] nodes, or any other work */
    const double* adjacency,                     /* [n_segments*n_segments] as m4gn_segments_graph gives it */
    int32_t n_ranks, const double* rank_weights, /* [n_ranks] shares of the work, of any sum; NULL: equal */
    int32_t* segment_rank,                       /* [n_segments] */
    m4gn_rank_report* report);                   /* may be NULL */

/* ---- modes -------------------------------------------------------------------------------------- */

/* Modes of a solver's own pair of matrices: K phi = lambda M phi. */
typedef struct m4gn_modes m4gn_modes;

/* This rank's rows of a distributed square matrix. Rows and columns are numbered over all ranks, the rows of rank 0
 * first, then those of rank 1, and so on. */
typedef struct m4gn_csr
{
    int32_t n_rows;        /* rows of this rank; may be 0 */
    const int64_t* row;    /* [n_rows+1] row i holds entries row[i] to row[i+1]-1; row[0] is 0 */
    const int64_t* column; /* [row[n_rows]] columns, in any order within a row; entries of one place add up */
    const double* value;   /* [row[n_rows]] */
} m4gn_csr;

/* Collective. Solves for the modes of K and M that are symmetric and positive semi-definite; M may be singular, NULL is the
 * identity. On failure *modes is NULL. The settings are
 *
 *   name            default     meaning
 *   modes           6           how many. Repeated eigenvalues are taken whole: there may be more
 *   modal_solver    "auto"      "auto" (by size), "direct" (factorisation), "iterative" (multigrid)
 *   block           1           unknowns a point, in consecutive rows
 *   shift           null        a number a little below the eigenvalues wanted; null: estimated
 */
int32_t m4gn_modes_new(
    int32_t comm, /* MPI_Comm_c2f of the host's communicator, or M4GN_NO_MPI */
    const m4gn_csr* stiffness, const m4gn_csr* mass, const char* options,
    const double*
        positions, /* [3*n_rows/block] where the points are, m: signs of modes then do not depend on the
                                   numbering. NULL on all ranks: chosen by numbers */
    m4gn_modes** modes);

void m4gn_modes_free(m4gn_modes* modes);

/* Number of modes found. */
int32_t m4gn_modes_count(const m4gn_modes* modes);

/* Eigenvalues [count], ascending. */
int32_t m4gn_modes_eigenvalues(const m4gn_modes* modes, double* eigenvalues);

/* Mode `index`, 0 to count-1, of this rank's rows [n_rows]; scaled to phi^T M phi = (sum of the entries of M)/block,
 * a root mean square of 1. */
int32_t m4gn_modes_vector(const m4gn_modes* modes, int32_t index, double* vector);

/* ---- modes of elastic bodies --------------------------------------------------------------------- */

/* This rank's part of an elastic body: isotropic, linear, with its displacements on the points of the mesh. Finite
 * elements for cells of any shape; docs/solids.md says which. Labels are local; all zero but what is needed is fine. */
typedef struct m4gn_solid
{
    int32_t n_directions;  /* 3, or 2 on a mesh that is one cell thick in the third */
    int32_t directions[3]; /* which: 0 x, 1 y, 2 z */

    int32_t n_points;
    const int64_t*
        point_global;     /* [n_points] number of the point, 0 to N-1, the same on every rank that has it */
    const double* points; /* [3*n_points] m */

    int32_t n_faces; /* internal faces first */
    int32_t n_internal_faces;
    const int32_t*
        face_start; /* [n_faces+1] points of face f: face_points[face_start[f]] to [face_start[f+1]-1] */
    const int32_t* face_points;    /* around each face; the right-hand normal leaves the owner */
    const int32_t* face_owner;     /* [n_faces] cell */
    const int32_t* face_neighbour; /* [n_internal_faces] cell */

    int32_t n_cells;
    const double* young;   /* [n_cells] Young's modulus, Pa */
    const double* poisson; /* [n_cells] Poisson's ratio, above -1 and below 0.5 */
    const double* density; /* [n_cells] kg/m^3 */

    int32_t n_fixed;                 /* held points; one that any rank holds is held */
    const int32_t* fixed_point;      /* [n_fixed] */
    const int32_t* fixed_components; /* [n_fixed] sum of 1 (x), 2 (y), 4 (z); NULL: all three */

    int32_t plane_stress; /* 2-D: 0 plane strain, 1 plane stress */
    int32_t free_body;    /* 1: nothing needs to be held; 0: that is an error */
} m4gn_solid;

/* Collective. Modes K phi = omega^2 M phi: eigenvalues in 1/s^2; m4gn_modes_vector gives the displacement (x, y, z) of
 * each point, [3*n_points], scaled to a root mean square of 1 over the body. Of the settings of m4gn_modes_new there are
 * modes and modal_solver. On failure *modes is NULL. */
int32_t m4gn_solid_modes_new(
    int32_t comm, /* MPI_Comm_c2f of the host's communicator, or M4GN_NO_MPI */
    const m4gn_solid* body, const char* options, m4gn_modes** modes);

/* ---- recorder ----------------------------------------------------------------------------------- */

typedef struct m4gn_recorder m4gn_recorder;

typedef struct m4gn_recorder_field
{
    const char* name;
    int32_t components; /* 1 or 3 */
    int32_t dimensions[7];
} m4gn_recorder_field;

/* Collective. On failure *recorder is NULL. The settings are
 *
 *   name            default     meaning
 *   path                        final name of the HDF5 file; written beside it first, renamed when whole; must be given
 *   provenance      {}          application, case, ...: any object, kept with the data. That of rank 0 counts
 *   split           "train"     "train", "valid" or "test"
 *   overwrite       false       false: an existing file is an error
 */
int32_t m4gn_recorder_new(
    int32_t comm, const m4gn_mesh_data* mesh, const char* options, const m4gn_recorder_field* fields,
    int32_t n_fields, m4gn_recorder** recorder);

/* Collective. Appends a frame; fields by name, all of them; times must increase. */
int32_t m4gn_recorder_append(
    m4gn_recorder* recorder, double time, const m4gn_field* fields, int32_t n_fields);

/* Number of frames so far. */
int64_t m4gn_recorder_n_frames(const m4gn_recorder* recorder);

/* Collective. Completes the file and gives it its final name. Appending is then an error. */
int32_t m4gn_recorder_finish(m4gn_recorder* recorder);

/* Collective. Without a finish before, nothing is left behind. */
void m4gn_recorder_free(m4gn_recorder* recorder);

#ifdef __cplusplus
}
#endif

#endif
