/* The general warp as a custom call of XLA, so that it stands inside functions that JAX compiles.

   XLA calls with a frame of structures whose layout is stable (openxla.org/xla/custom_call): each begins with its size and
   a list of extensions. Declared here is what is read, so that the build needs no headers of jaxlib. */

#include <stddef.h>

typedef struct Extension {
    size_t size;
    int32_t kind; /* 1: the caller asks for the version of these structures */
    struct Extension *next;
} Extension;

typedef struct {
    size_t size;
    Extension *extensions;
    int major, minor;
} Version;

typedef struct {
    Extension base;
    struct {
        size_t size;
        Version version;
        uint32_t traits;
    } *answer;
} VersionQuestion;

typedef struct {
    size_t size;
    Extension *extensions;
    const char *message;
    int32_t code;
} ErrorText;

typedef struct {
    size_t size;
    Extension *extensions;
    Version version;
    const void *internal;
    void *(*make_error)(ErrorText *);
} Functions;

typedef struct {
    size_t size;
    Extension *extensions;
    int32_t type;
    void *data;
    int64_t rank, *dims;
} Buffer;

typedef struct {
    size_t size;
    Extension *extensions;
    int64_t count;
    const int32_t *kinds; /* 1: a buffer */
    Buffer **buffers;
} Buffers;

typedef struct {
    size_t size;
    Extension *extensions;
    const Functions *functions;
    void *context;
    int32_t stage;
    Buffers operands, results;
} Frame;

enum { VERSION_QUESTION = 1, EXECUTE = 3, INVALID_ARGUMENT = 3, RESOURCE_EXHAUSTED = 8 };

/* XLA's numbers of the voxel types. */
enum { XLA_S8 = 2, XLA_S16 = 3, XLA_S32 = 4, XLA_U8 = 6, XLA_U16 = 7, XLA_U32 = 8, XLA_F32 = 11, XLA_F64 = 12 };
static const int XLA_TYPES[VOXEL_TYPES] = {XLA_U8, XLA_S8, XLA_U16, XLA_S16, XLA_S32, XLA_F32, XLA_F64};

/* samples [z, y, x], displacements [x y z][z, y, x] of the output, whole and part of its three axes and the matrix as
   doubles in pairs of words, the voxel outside, and: method, is_far, is_straight. */
enum { SAMPLES, DISPLACEMENTS, WHOLE, PART = WHOLE + 3, MATRIX = PART + 3, FILL, SETTINGS, OPERANDS };

static const Loops *xla_loops;
static int xla_major, xla_minor;

/* The loops to use, and the version of the structures that jaxlib's header names. */
EXPORT void deformnb_xla_use(const Loops *loops, int major, int minor) {
    xla_loops = loops;
    xla_major = major;
    xla_minor = minor;
}

static void *xla_error(const Frame *frame, int code, const char *message) {
    ErrorText text = {sizeof text, NULL, message, code};
    return frame->functions->make_error(&text);
}

static int has_shape(const Buffer *buffer, int type, int64_t rank, const int64_t *dims) {
    if (buffer->type != type || buffer->rank != rank) return 0;
    for (int64_t k = 0; k < rank; k++)
        if (buffer->dims[k] != dims[k]) return 0;
    return 1;
}

EXPORT void *deformnb_xla_general(Frame *frame) {
    for (Extension *asked = frame->extensions; asked; asked = asked->next)
        if (asked->kind == VERSION_QUESTION) {
            VersionQuestion *question = (VersionQuestion *)asked;
            question->answer->version.major = xla_major;
            question->answer->version.minor = xla_minor;
            return NULL;
        }
    if (frame->stage != EXECUTE) return NULL;
    const char *const misfit = "deformnb_general: operands do not fit each other";
    if (frame->operands.count != OPERANDS || frame->results.count != 1)
        return xla_error(frame, INVALID_ARGUMENT, misfit);
    Buffer **in = frame->operands.buffers, *out = frame->results.buffers[0];
    Source source = {.samples = in[SAMPLES]->data, .fill = in[FILL]->data, .voxel_type = -1};
    for (int type = 0; type < VOXEL_TYPES; type++)
        if (XLA_TYPES[type] == in[SAMPLES]->type) source.voxel_type = type;
    const int64_t one = 1, three = 3, matrix_words = 18;
    if (source.voxel_type < 0 || in[SAMPLES]->rank != 3 || out->rank != 3 || out->type != in[SAMPLES]->type ||
        !has_shape(in[FILL], out->type, 1, &one) || !has_shape(in[MATRIX], XLA_U32, 1, &matrix_words) ||
        !has_shape(in[SETTINGS], XLA_S32, 1, &three))
        return xla_error(frame, INVALID_ARGUMENT, misfit);
    const int64_t *n = out->dims, moves[4] = {3, n[0], n[1], n[2]};
    if (!has_shape(in[DISPLACEMENTS], XLA_F32, 4, moves)) return xla_error(frame, INVALID_ARGUMENT, misfit);
    Target target = {out->data, {n[1] * n[2], n[2]}, {0, 0, 0}, {n[0], n[1], n[2]}};
    Field field = {.stride = {n[1] * n[2], n[2], 1}};
    for (int a = 0; a < 3; a++) {
        const int64_t words[2] = {3, 2 * n[a]};
        if (!has_shape(in[WHOLE + a], XLA_U32, 2, words) || !has_shape(in[PART + a], XLA_U32, 2, words) ||
            in[SAMPLES]->dims[a] < 1)
            return xla_error(frame, INVALID_ARGUMENT, misfit);
        source.shape[a] = in[SAMPLES]->dims[a];
        source.count[a] = n[a];
        source.whole[a] = in[WHOLE + a]->data;
        source.part[a] = in[PART + a]->data;
        field.d[a] = (const float *)in[DISPLACEMENTS]->data + a * n[0] * n[1] * n[2];
    }
    const double *matrix = in[MATRIX]->data;
    for (int k = 0; k < 9; k++) source.matrix[k] = matrix[k];
    const int32_t *settings = in[SETTINGS]->data;
    source.method = settings[0];
    source.is_far = settings[1];
    source.is_straight = settings[2];
    if (source.method != NEAREST && source.method != LINEAR) return xla_error(frame, INVALID_ARGUMENT, misfit);
    if (xla_loops->general(&source, &field, &target) == 1) /* a displacement that is not finite leads outside */
        return xla_error(frame, RESOURCE_EXHAUSTED, "deformnb_general: there is not enough memory");
    return NULL;
}
