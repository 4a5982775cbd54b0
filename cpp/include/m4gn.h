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
 * status on all ranks, so that no rank waits for another that has left.
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

#define M4GN_ABI_VERSION 3

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

/* This rank's part of the mesh. Local labels; `empty` patches contribute nothing. A solver with its unknowns at points hands
 * in points for cells, edges for faces, and a boundary face at each point of a patch (openfoam/mesh/m4gnPointAdapter.H). */
typedef struct m4gn_mesh_data
{
    int32_t n_directions;       /* 2 or 3 solved directions */
    int32_t directions[3];      /* which: 0 x, 1 y, 2 z */

    int32_t n_cells;
    const int64_t* cell_global; /* [n_cells] number of the cell in the undecomposed mesh, 0-based; a
                                   permutation of 0..N over all ranks */
    const double* cell_centres; /* [3*n_cells] m */
    const double* cell_volumes; /* [n_cells] m^3 */

    int32_t n_faces;            /* internal faces of this rank */
    const int32_t* face_owner;  /* [n_faces] */
    const int32_t* face_neighbour; /* [n_faces] */
    const double* face_coeff;   /* [n_faces] |off-diagonal| of the solver's Laplacian with unit diffusivity, m */

    int32_t n_boundary;         /* faces of patches that carry values (neither empty nor coupled) */
    const int32_t* boundary_owner;   /* [n_boundary] cell */
    const int64_t* boundary_global;  /* [n_boundary] number among all such faces in the undecomposed mesh;
                                        a permutation of 0..B over all ranks */
    const double* boundary_centres;  /* [3*n_boundary] m */
    const double* boundary_area;     /* [3*n_boundary] outward area vector, m^2 */
    const double* boundary_coeff;    /* [n_boundary] diagonal contribution of a Dirichlet condition, m */
    const int32_t* boundary_type;    /* [n_boundary] M4GN_WALL ... M4GN_FREE */
    const int32_t* boundary_patch;   /* [n_boundary] index into patch_names */

    int32_t n_coupled;          /* faces of processor and translational cyclic patches, one entry a side */
    const int32_t* coupled_owner;    /* [n_coupled] cell on this side */
    const int32_t* coupled_rank;     /* [n_coupled] rank of the cell on the other side */
    const int64_t* coupled_global;   /* [n_coupled] cell_global of the cell on the other side */
    const double* coupled_delta;     /* [3*n_coupled] from this cell's centre to the other's through the coupling, m */
    const double* coupled_coeff;     /* [n_coupled] as face_coeff */

    int32_t n_patches;
    const char* const* patch_names;  /* [n_patches] */

    int32_t n_modes;            /* modes of the elastic body (m4gn_solid_modes_new), of which segments are then made;
                                   0: none are given */
    const double* mode_eigenvalues;  /* [n_modes] 1/s^2, ascending; a repeated one whole; the same on all ranks */
    const double* mode_cells;   /* [3*n_cells*n_modes] mode after mode, the displacement of each cell: the mean of its
                                   points' */
} m4gn_mesh_data;

/* A field at one time, on this rank. */
typedef struct m4gn_field
{
    const char* name;           /* OpenFOAM's name, "U" */
    int32_t components;         /* 1 scalar, 3 vector */
    const double* cells;        /* [components*n_cells] */
    const double* boundary;     /* [components*n_boundary] face values */
} m4gn_field;

/* Where a predicted field goes; components that are not solved are left as they are. */
typedef struct m4gn_field_out
{
    const char* name;
    int32_t components;
    double* cells;              /* [components*n_cells] */
} m4gn_field_out;

/* ---- surrogate ---------------------------------------------------------------------------------- */

typedef struct m4gn_session m4gn_session;

/* Zero or NULL means: as the model was trained. */
typedef struct m4gn_session_options
{
    const char* model;          /* path of the .safetensors file */
    const char* backend;        /* "native" (NULL) or "torch" */
    int32_t n_threads;          /* threads of this rank; 0: 1 */
    int32_t segments;           /* K; 0: the model's */
    int32_t modes;              /* m; < 0: the model's */
    int32_t overlap;            /* delta; < 0: the model's */
    int32_t slic_iterations;    /* < 0: the model's */
    double tau;                 /* < 0: the model's */
    double segment_size;        /* S, m; <= 0: the model's */
    const char* segment_method; /* "metis", "slic-md", "slic-mdodl", "slic-mdode"; NULL: the model's */
    const int32_t* cell_segment;/* [n_cells] segments computed before (m4gnSegment); NULL: compute */
    const char* precision;      /* "fp32" (NULL) or "bf16": of the native backend's products */
    double energy;              /* share of the energy that as many modes hold, (0, 1]; modes is then the most;
                                   <= 0: the model's */
    int32_t connected;          /* every segment connected, 1 yes, 0 no; < 0: the model's */
    double distance_scale;      /* length of the distance to the obstacle, m; 0: off (the paper); < 0: the model's */
    const char* obstacles;      /* patches that are the obstacle, "a, b"; NULL: the model's */
    const char* modal_solver;   /* "auto" (NULL), "direct" or "iterative" */
    const char* petsc_options;  /* for the modes, "-m4gn_eps_tol 1e-9 ..."; NULL: none */
    const char* modal_operator; /* "laplacian" or "elastic" (the mesh's own modes); NULL: the model's */
} m4gn_session_options;

/* Fills in "as the model was trained" everywhere; set model afterwards. */
void m4gn_session_options_init(m4gn_session_options* options);

/* Collective. How many modes of the elastic body the mesh must have for this model's segments; 0: none, they are of the
 * Laplacian's or of no modes. Negative after an error. */
int32_t m4gn_model_elastic_modes(int32_t comm, const char* model);

/* Collective. Builds graph, modes and segments and loads the model. On failure *session is NULL. */
int32_t m4gn_session_new(
    int32_t comm,               /* MPI_Comm_c2f of the host's communicator, or M4GN_NO_MPI; duplicated */
    const m4gn_mesh_data* mesh,
    const m4gn_session_options* options,
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
    const char* name;           /* valid while the session lives */
    int32_t components;         /* 1 or 3 */
    int32_t dimensions[7];      /* dimensionSet exponents */
    int32_t is_input;
    int32_t is_output;
} m4gn_field_info;

int32_t m4gn_session_field(const m4gn_session* session, int32_t index, m4gn_field_info* info);

/* Segment of each cell [n_cells], 0 to K-1. */
int32_t m4gn_session_segments(const m4gn_session* session, int32_t* cell_segment);

/* Collective. One step: reads every input field (cells and boundary values at time t), writes every output
 * field's cells at t + stride. `in` and `out` may name the same arrays. A non-finite result is an error
 * (M4GN_ERROR_NUMERICAL) and leaves `out` untouched. */
int32_t m4gn_session_step(
    m4gn_session* session,
    const m4gn_field* in,
    int32_t n_in,
    const m4gn_field_out* out,
    int32_t n_out);

/* ---- segments ----------------------------------------------------------------------------------- */

/* Segments of a mesh without a model, and its Laplacian modes. */
typedef struct m4gn_segments m4gn_segments;

typedef struct m4gn_segment_options
{
    const char* model;          /* model file whose segmentation is meant; NULL: m4gn's defaults */
    const char* spec;           /* JSON object with entries that differ, by the names of a model's description:
                                   {"method": "slic-md", "count": 36, "modes": 6, "tau": 1.0, ...}; NULL: {} */
    const int32_t* cell_segment;/* [n_cells] segments computed before (m4gnSegment); NULL: compute */
    const char* modal_solver;   /* as in m4gn_session_options */
    const char* petsc_options;  /* as in m4gn_session_options */
    int32_t with_modes;         /* 0: m4gn_segments_n_modes is 0, and with cell_segment nothing is solved */
} m4gn_segment_options;

/* Collective. Cuts the mesh; on failure *segments is NULL. */
int32_t m4gn_segments_new(
    int32_t comm,
    const m4gn_mesh_data* mesh,
    const m4gn_segment_options* options,
    m4gn_segments** segments);

void m4gn_segments_free(m4gn_segments* segments);

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
    double cut;                 /* faces between segments of different ranks */
    double imbalance;           /* largest load over its rank's share; 1: perfect */
} m4gn_rank_report;

/* Not collective; a function of its arguments alone. The rank of each segment, so that every rank has at least one,
 * loads are balanced and few faces lie between ranks. n_segments < n_ranks is an error. */
int32_t m4gn_segment_ranks(
    int32_t n_segments,
    const double* sizes,        /* [n_segments] nodes, or any other work */
    const double* adjacency,    /* [n_segments*n_segments] as m4gn_segments_graph gives it */
    int32_t n_ranks,
    const double* rank_weights, /* [n_ranks] shares of the work, of any sum; NULL: equal */
    const int32_t* fixed,       /* [n_segments] rank that a segment is bound to, -1: free; NULL: all free */
    int32_t* segment_rank,      /* [n_segments] */
    m4gn_rank_report* report);  /* may be NULL */

/* ---- modes -------------------------------------------------------------------------------------- */

/* Modes of a solver's own pair of matrices: K phi = lambda M phi. */
typedef struct m4gn_modes m4gn_modes;

/* This rank's rows of a distributed square matrix. Rows and columns are numbered over all ranks, the rows of rank 0
 * first, then those of rank 1, and so on. */
typedef struct m4gn_csr
{
    int32_t n_rows;             /* rows of this rank; may be 0 */
    const int64_t* row;         /* [n_rows+1] row i holds entries row[i] to row[i+1]-1; row[0] is 0 */
    const int64_t* column;      /* [row[n_rows]] columns, in any order within a row; entries of one place add up */
    const double* value;        /* [row[n_rows]] */
} m4gn_csr;

typedef struct m4gn_modes_options
{
    int32_t modes;              /* how many; default 6. Repeated eigenvalues are taken whole: there may be more */
    int32_t symmetric;          /* default 1: K and M are symmetric and positive semi-definite, M may be singular.
                                   0: a pair that is not, solved as it is for the eigenvalues nearest to the shift */
    int32_t block;              /* unknowns a point, in consecutive rows; default 1 */
    double energy;              /* > 0: only as many modes as hold this share, at most 1, of the sum of 1/lambda over
                                   the first `modes`; default 0: all of them */
    double shift;               /* a number a little below the eigenvalues wanted; NAN (default): estimated */
    const double* positions;    /* [3*n_rows/block] where the points are, m: signs of modes then do not depend on the
                                   numbering. NULL (default) on all ranks: chosen by numbers */
    const char* solver;         /* "auto" (NULL) by size, "direct" (factorisation), "iterative" (multigrid) */
    const char* petsc;          /* options of PETSc and SLEPc, "-m4gn_eps_tol 1e-9 ..."; NULL: none */
} m4gn_modes_options;

/* Fills in the defaults. */
void m4gn_modes_options_init(m4gn_modes_options* options);

/* Collective. Solves for the modes; `mass` NULL is the identity. On failure *modes is NULL. */
int32_t m4gn_modes_new(
    int32_t comm,               /* MPI_Comm_c2f of the host's communicator, or M4GN_NO_MPI */
    const m4gn_csr* stiffness,
    const m4gn_csr* mass,
    const m4gn_modes_options* options,
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
    int32_t n_directions;       /* 3, or 2 on a mesh that is one cell thick in the third */
    int32_t directions[3];      /* which: 0 x, 1 y, 2 z */

    int32_t n_points;
    const int64_t* point_global;/* [n_points] number of the point, 0 to N-1, the same on every rank that has it */
    const double* points;       /* [3*n_points] m */

    int32_t n_faces;            /* internal faces first */
    int32_t n_internal_faces;
    const int32_t* face_start;  /* [n_faces+1] points of face f: face_points[face_start[f]] to [face_start[f+1]-1] */
    const int32_t* face_points; /* around each face; the right-hand normal leaves the owner */
    const int32_t* face_owner;  /* [n_faces] cell */
    const int32_t* face_neighbour; /* [n_internal_faces] cell */

    int32_t n_cells;
    const double* young;        /* [n_cells] Young's modulus, Pa */
    const double* poisson;      /* [n_cells] Poisson's ratio, above -1 and below 0.5 */
    const double* density;      /* [n_cells] kg/m^3 */

    int32_t n_fixed;            /* held points; one that any rank holds is held */
    const int32_t* fixed_point; /* [n_fixed] */
    const int32_t* fixed_components; /* [n_fixed] sum of 1 (x), 2 (y), 4 (z); NULL: all three */

    int32_t plane_stress;       /* 2-D: 0 plane strain, 1 plane stress */
    int32_t lumped_mass;        /* 0 consistent, 1 lumped */
    int32_t free_body;          /* 1: nothing needs to be held; 0: that is an error */
} m4gn_solid;

/* Collective. Modes K phi = omega^2 M phi: eigenvalues in 1/s^2; m4gn_modes_vector gives the displacement (x, y, z) of
 * each point, [3*n_points], scaled to a root mean square of 1 over the body. Of `options`, modes, energy, solver and
 * petsc count. On failure *modes is NULL. */
int32_t m4gn_solid_modes_new(
    int32_t comm,               /* MPI_Comm_c2f of the host's communicator, or M4GN_NO_MPI */
    const m4gn_solid* body,
    const m4gn_modes_options* options,
    m4gn_modes** modes);

/* ---- recorder ----------------------------------------------------------------------------------- */

typedef struct m4gn_recorder m4gn_recorder;

typedef struct m4gn_recorder_field
{
    const char* name;
    int32_t components;         /* 1 or 3 */
    int32_t dimensions[7];
} m4gn_recorder_field;

typedef struct m4gn_recorder_options
{
    const char* path;           /* final name of the HDF5 file; written beside it first, renamed when whole */
    int32_t n_fields;
    const m4gn_recorder_field* fields;
    const char* provenance;     /* JSON object: application, case, ...; NULL: {} */
    const char* split;          /* "train", "valid", "test" or NULL */
    int32_t overwrite;          /* 0: an existing file is an error */
} m4gn_recorder_options;

/* Collective. */
int32_t m4gn_recorder_new(
    int32_t comm,
    const m4gn_mesh_data* mesh,
    const m4gn_recorder_options* options,
    m4gn_recorder** recorder);

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
