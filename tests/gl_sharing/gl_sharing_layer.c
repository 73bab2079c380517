/* An OpenCL layer (cl_loader_layers) that adds a strict cl_khr_gl_sharing to drivers without it, for tests.
 *
 * A shared buffer has two stores, OpenGL's and the driver's. Its bytes are in one of them, the other one is
 * poisoned. Acquiring copies OpenGL's bytes to the driver. Releasing copies them back, and OpenGL sees them
 * once the queue has finished, for no more is promised: "After releasing a shared memory object, the
 * application is responsible for ensuring that any pending OpenCL operations [...] have completed"
 * (Synchronizing OpenCL Operations With Other APIs). Quotations are from the unified OpenCL specification,
 * which includes cl_khr_gl_sharing: https://registry.khronos.org/OpenCL/
 *
 * Environment:
 *   GL_SHARING_LAYER_LOG   file to append to: a line "misuse: ..." for each, a line of counts at exit
 *   GL_SHARING_LAYER_FAIL  name of a function that fails: one of the extension, or clCreateContext
 *
 * Limits: only buffers, EGL, and the commands in clInitLayer; no events; contexts are not forgotten.
 */
#include <dlfcn.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* What is needed of cl.h, cl_gl.h, cl_icd.h and cl_layer.h, for OpenCL's headers are often not installed. */
typedef int32_t cl_int;
typedef uint32_t cl_uint;
typedef uint64_t cl_bitfield;
typedef struct _cl_context *cl_context;
typedef struct _cl_command_queue *cl_command_queue;
typedef struct _cl_device_id *cl_device_id;
typedef struct _cl_event *cl_event;
typedef struct _cl_kernel *cl_kernel;
typedef struct _cl_mem *cl_mem;

enum { /* errors */
    CL_SUCCESS = 0, CL_OUT_OF_RESOURCES = -5, CL_INVALID_VALUE = -30, CL_INVALID_CONTEXT = -34,
    CL_INVALID_OPERATION = -59, CL_INVALID_GL_OBJECT = -60, CL_INVALID_GL_SHAREGROUP_REFERENCE_KHR = -1000
};
enum { /* parameters, properties, flags */
    CL_DEVICE_EXTENSIONS = 0x1030, CL_KERNEL_REFERENCE_COUNT = 0x1192, CL_GL_CONTEXT_KHR = 0x2008,
    CL_EGL_DISPLAY_KHR = 0x2009, CL_MEM_READ_WRITE = 1, CL_MEM_WRITE_ONLY = 2, CL_MEM_READ_ONLY = 4,
    CL_LAYER_API_VERSION = 0x4240, CL_LAYER_NAME = 0x4241, CL_LAYER_API_VERSION_100 = 100
};
enum { /* entries of struct _cl_icd_dispatch */
    clGetDeviceInfo = 3, clCreateContext = 4, clCreateBuffer = 14, clReleaseKernel = 37, clSetKernelArg = 38,
    clGetKernelInfo = 39, clFinish = 47, clEnqueueReadBuffer = 48, clEnqueueWriteBuffer = 49,
    clEnqueueCopyBuffer = 50, clEnqueueMapBuffer = 56, clEnqueueNDRangeKernel = 59, clCreateFromGLBuffer = 66,
    clEnqueueAcquireGLObjects = 72, clEnqueueReleaseGLObjects = 73, clCreateSubBuffer = 82,
    clSetMemObjectDestructorCallback = 83, clEnqueueFillBuffer = 102, USED_ENTRIES = 103
};
typedef void (*function)(void);
static function below[USED_ENTRIES]; /* the loader's, or those of the next layer */
#define EVENT_TYPES cl_uint, const cl_event *, cl_event *
#define NO_EVENTS 0, NULL, NULL
#define BELOW(name, result, ...) ((result (*)(__VA_ARGS__))below[name])

/* ---- Reports ---- */

static unsigned buffers, acquired, released, kernel_arguments, misuses;

#define REPORT(...) \
    do { \
        const char *path = getenv("GL_SHARING_LAYER_LOG"); \
        FILE *log = path ? fopen(path, "a") : stderr; \
        if (log) fprintf(log, __VA_ARGS__); \
        if (log && path) fclose(log); \
    } while (0)

static cl_int misuse(const char *what, unsigned name, cl_int error)
{
    ++misuses;
    REPORT("misuse: %s (OpenGL buffer %u)\n", what, name);
    return error;
}

static void report_counts(void)
{
    if (buffers)
        REPORT("buffers %u, acquired %u, released %u, kernel arguments %u, misuses %u\n", buffers, acquired,
               released, kernel_arguments, misuses);
}

static void *allocated(size_t size)
{
    void *made = calloc(1, size);
    if (!made) abort();
    return made;
}

static int must_fail(const char *name)
{
    const char *wanted = getenv("GL_SHARING_LAYER_FAIL");
    return wanted && !strcmp(wanted, name);
}

/* ---- OpenGL, by direct state access, which leaves bindings alone ---- */

enum { GL_BUFFER_SIZE = 0x8764, GL_R8UI = 0x8232, GL_RED_INTEGER = 0x8D94, GL_UNSIGNED_BYTE = 0x1401 };
static const uint8_t POISON = 0xFF; /* as float: NaN */

static function egl(const char *name)
{
    static void *library;
    if (!library) library = dlopen("libEGL.so.1", RTLD_NOW);
    return library ? (function)dlsym(library, name) : NULL;
}

static void *current(const char *query) /* "eglGetCurrentContext" or "eglGetCurrentDisplay" */
{
    function get = egl(query);
    return get ? ((void *(*)(void))get)() : NULL;
}
#define GL(name, result, ...) \
    ((result (*)(__VA_ARGS__))((function (*)(const char *))egl("eglGetProcAddress"))(name))

static int64_t gl_size(unsigned name) /* 0 where there is no such buffer, or no store */
{
    int64_t size = 0;
    if (GL("glIsBuffer", unsigned char, unsigned)(name))
        GL("glGetNamedBufferParameteri64v", void, unsigned, unsigned, int64_t *)(name, GL_BUFFER_SIZE, &size);
    return size;
}

static void gl_poison(unsigned name)
{
    GL("glClearNamedBufferData", void, unsigned, unsigned, unsigned, unsigned,
       const void *)(name, GL_R8UI, GL_RED_INTEGER, GL_UNSIGNED_BYTE, &POISON);
}

/* ---- What is shared ---- */

struct sharing_context {
    cl_context context;
    void *gl;
    struct sharing_context *next;
};
struct shared {
    cl_mem mem;
    struct shared *whole; /* of a sub-buffer: what it is part of; else itself */
    void *gl;
    unsigned name;
    size_t size;
    int is_acquired;
    uint8_t *bytes;         /* room for all of it */
    cl_command_queue until; /* released: OpenGL gets `bytes` once this queue has finished */
    struct shared *next;
};
struct argument {
    cl_kernel kernel;
    cl_uint index;
    struct shared *buffer;
    struct argument *next;
};
static struct sharing_context *contexts;
static struct shared *all;
static struct argument *arguments;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

static struct shared *find(cl_mem mem)
{
    pthread_mutex_lock(&lock);
    struct shared *each = all;
    while (each && each->mem != mem) each = each->next;
    pthread_mutex_unlock(&lock);
    return each;
}

/* Forget arguments: of a kernel (any index where it is negative), or that are a buffer. */
static void forget_arguments(cl_kernel kernel, int64_t index, struct shared *buffer)
{
    for (struct argument **at = &arguments; *at;) {
        struct argument *each = *at;
        if (each->buffer == buffer || (each->kernel == kernel && (index < 0 || each->index == index))) {
            *at = each->next;
            free(each);
        } else
            at = &each->next;
    }
}

static void forget(cl_mem mem, void *record) /* the driver is about to delete it */
{
    struct shared *gone = record;
    (void)mem;
    if (gone->is_acquired) misuse("deleted while it is acquired", gone->name, 0);
    pthread_mutex_lock(&lock);
    forget_arguments(NULL, -1, gone);
    struct shared **at = &all;
    while (*at != gone) at = &(*at)->next;
    *at = gone->next;
    pthread_mutex_unlock(&lock);
    free(gone->bytes);
    free(gone);
}

static struct shared *remember(cl_mem mem, struct shared *whole)
{
    struct shared *made = allocated(sizeof *made);
    made->mem = mem;
    made->whole = whole ? whole : made;
    pthread_mutex_lock(&lock);
    made->next = all;
    all = made;
    pthread_mutex_unlock(&lock);
    BELOW(clSetMemObjectDestructorCallback, cl_int, cl_mem, void (*)(cl_mem, void *), void *)
    (mem, forget, made);
    return made;
}

/* "These objects need to be acquired before they can be used by any OpenCL commands queued to a command-queue
 * or the behavior is undefined" (clEnqueueAcquireGLObjects). */
static void check_acquired(cl_mem mem, const char *command)
{
    struct shared *buffer = find(mem);
    if (buffer && !buffer->whole->is_acquired) misuse(command, buffer->whole->name, 0);
}

/* ---- Functions of the extension ---- */

static cl_int device_info(cl_device_id device, cl_uint parameter, size_t room, void *value, size_t *needed)
{
    static const char added[] = " cl_khr_gl_sharing";
    size_t size = 0;
    cl_int (*get)(cl_device_id, cl_uint, size_t, void *, size_t *) = (void *)below[clGetDeviceInfo];
    if (parameter != CL_DEVICE_EXTENSIONS) return get(device, parameter, room, value, needed);
    cl_int error = get(device, parameter, 0, NULL, &size);
    if (error) return error;
    if (needed) *needed = size + sizeof added - 1;
    if (!value) return CL_SUCCESS;
    if (room < size + sizeof added - 1) return CL_INVALID_VALUE;
    error = get(device, parameter, size, value, NULL);
    strcat(value, added);
    return error;
}

static cl_context create_context(const intptr_t *properties, cl_uint count, const cl_device_id *devices,
                                 void (*notify)(const char *, const void *, size_t, void *), void *data,
                                 cl_int *error)
{
    intptr_t kept[64] = {0};
    void *gl = NULL, *display = NULL;
    int length = 0;
    for (const intptr_t *each = properties; each && *each && length < 60; each += 2) {
        if (each[0] == CL_GL_CONTEXT_KHR)
            gl = (void *)each[1];
        else if (each[0] == CL_EGL_DISPLAY_KHR)
            display = (void *)each[1];
        else
            memcpy(kept + length, each, 2 * sizeof *each), length += 2;
    }
    /* CL_INVALID_GL_SHAREGROUP_REFERENCE_KHR: "The specified display and context properties do not identify a
     * valid OpenGL or OpenGL ES context". The only one known to be valid here is the current one. */
    if (gl && (must_fail("clCreateContext") || gl != current("eglGetCurrentContext") ||
               display != current("eglGetCurrentDisplay"))) {
        if (error) *error = CL_INVALID_GL_SHAREGROUP_REFERENCE_KHR;
        return NULL;
    }
    cl_context made = BELOW(clCreateContext, cl_context, const intptr_t *, cl_uint, const cl_device_id *,
                            void (*)(const char *, const void *, size_t, void *), void *,
                            cl_int *)(length ? kept : NULL, count, devices, notify, data, error);
    if (made && gl) {
        struct sharing_context *record = allocated(sizeof *record);
        pthread_mutex_lock(&lock);
        *record = (struct sharing_context){made, gl, contexts};
        contexts = record; /* the newest first: a driver may give out the address of one that is gone */
        pthread_mutex_unlock(&lock);
    }
    return made;
}

/* "CL_INVALID_CONTEXT if context is not a valid context or was not created from an OpenGL context.
 * CL_INVALID_VALUE if values specified in flags are not valid. CL_INVALID_GL_OBJECT if bufobj is not an
 * OpenGL buffer object or is a OpenGL buffer object but does not have an existing data store or the size of
 * the buffer is 0" (clCreateFromGLBuffer). */
static cl_mem create_from_gl_buffer(cl_context context, cl_bitfield flags, unsigned name, cl_int *error)
{
    cl_int ignored, status = CL_SUCCESS;
    if (!error) error = &ignored;
    pthread_mutex_lock(&lock);
    struct sharing_context *sharing = contexts;
    while (sharing && sharing->context != context) sharing = sharing->next;
    pthread_mutex_unlock(&lock);
    if (must_fail("clCreateFromGLBuffer"))
        status = CL_OUT_OF_RESOURCES;
    else if (!sharing)
        status = misuse("created in a context without OpenGL", name, CL_INVALID_CONTEXT);
    else if (current("eglGetCurrentContext") != sharing->gl)
        status = misuse("created while its OpenGL context is not current", name, CL_INVALID_CONTEXT);
    else if (!flags || flags & ~(cl_bitfield)(CL_MEM_READ_WRITE | CL_MEM_WRITE_ONLY | CL_MEM_READ_ONLY))
        status = misuse("created with flags that do not apply", name, CL_INVALID_VALUE);
    else if (!gl_size(name))
        status = misuse("created of no buffer with a data store", name, CL_INVALID_GL_OBJECT);
    *error = status;
    if (status) return NULL;
    size_t size = (size_t)gl_size(name);
    cl_mem mem = BELOW(clCreateBuffer, cl_mem, cl_context, cl_bitfield, size_t, void *,
                       cl_int *)(context, CL_MEM_READ_WRITE, size, NULL, error);
    if (!mem) return NULL;
    struct shared *made = remember(mem, NULL);
    made->gl = sharing->gl, made->name = name, made->size = size, made->bytes = allocated(size);
    ++buffers;
    return mem;
}

static cl_mem create_sub_buffer(cl_mem mem, cl_bitfield flags, cl_uint kind, const void *region,
                                cl_int *error)
{
    cl_mem part = BELOW(clCreateSubBuffer, cl_mem, cl_mem, cl_bitfield, cl_uint, const void *,
                        cl_int *)(mem, flags, kind, region, error);
    struct shared *whole = find(mem);
    if (part && whole) remember(part, whole);
    return part;
}

static void show_to_gl(struct shared *buffer)
{
    buffer->until = NULL;
    if (current("eglGetCurrentContext") != buffer->gl)
        misuse("finished while its OpenGL context is not current", buffer->name, 0);
    else
        GL("glNamedBufferSubData", void, unsigned, intptr_t, intptr_t,
           const void *)(buffer->name, 0, (intptr_t)buffer->size, buffer->bytes);
}

/* "CL_INVALID_GL_OBJECT if memory objects in mem_objects have not been created from an OpenGL object(s)"
 * (clEnqueueAcquireGLObjects). "If the state of an OpenGL buffer object is modified through the OpenGL API
 * (e.g. glBufferData) while there exists a corresponding OpenCL buffer object, subsequent use of the OpenCL
 * buffer object will result in undefined behavior" (clCreateFromGLBuffer). */
static cl_int check_handed_over(struct shared *buffer, int is_acquired, const char *twice)
{
    if (!buffer || buffer->whole != buffer)
        return misuse("acquired or released, but not created from OpenGL", 0, CL_INVALID_GL_OBJECT);
    if (current("eglGetCurrentContext") != buffer->gl)
        return misuse("acquired or released while its OpenGL context is not current", buffer->name,
                      CL_INVALID_CONTEXT);
    if ((size_t)gl_size(buffer->name) != buffer->size)
        return misuse("its data store was changed or deleted", buffer->name, CL_INVALID_GL_OBJECT);
    if (buffer->is_acquired != is_acquired) return misuse(twice, buffer->name, CL_INVALID_OPERATION);
    return CL_SUCCESS;
}

static cl_int acquire_one(cl_command_queue queue, struct shared *buffer)
{
    cl_int error = check_handed_over(buffer, 0, "acquired twice");
    if (error) return error;
    if (buffer->until) show_to_gl(buffer);
    GL("glGetNamedBufferSubData", void, unsigned, intptr_t, intptr_t,
       void *)(buffer->name, 0, (intptr_t)buffer->size, buffer->bytes);
    gl_poison(buffer->name);
    buffer->is_acquired = 1;
    ++acquired;
    return BELOW(clEnqueueWriteBuffer, cl_int, cl_command_queue, cl_mem, cl_uint, size_t, size_t,
                 const void *, EVENT_TYPES)(queue, buffer->mem, 1, 0, buffer->size, buffer->bytes, NO_EVENTS);
}

static cl_int release_one(cl_command_queue queue, struct shared *buffer)
{
    cl_int error = check_handed_over(buffer, 1, "released without being acquired");
    if (error) return error;
    buffer->is_acquired = 0;
    buffer->until = queue;
    ++released;
    error = BELOW(clEnqueueReadBuffer, cl_int, cl_command_queue, cl_mem, cl_uint, size_t, size_t, void *,
                  EVENT_TYPES)(queue, buffer->mem, 1, 0, buffer->size, buffer->bytes, NO_EVENTS);
    if (error) return error;
    return BELOW(clEnqueueFillBuffer, cl_int, cl_command_queue, cl_mem, const void *, size_t, size_t, size_t,
                 EVENT_TYPES)(queue, buffer->mem, &POISON, 1, 0, buffer->size, NO_EVENTS);
}

#define HAND_OVER(our_name, name, one) \
    static cl_int our_name(cl_command_queue queue, cl_uint count, const cl_mem *mems, cl_uint waits, \
                           const cl_event *wait_for, cl_event *event) \
    { \
        (void)wait_for; \
        if (must_fail(name)) return CL_OUT_OF_RESOURCES; \
        if (waits || event) return misuse("this layer has no events", 0, CL_INVALID_OPERATION); \
        cl_int error = CL_SUCCESS; \
        for (cl_uint i = 0; i < count && !error; ++i) error = one(queue, find(mems[i])); \
        return error; \
    }
HAND_OVER(acquire, "clEnqueueAcquireGLObjects", acquire_one)
HAND_OVER(release, "clEnqueueReleaseGLObjects", release_one)

/* ---- Commands that may use a shared buffer ---- */

static cl_int finish(cl_command_queue queue)
{
    cl_int error = BELOW(clFinish, cl_int, cl_command_queue)(queue);
    pthread_mutex_lock(&lock);
    for (struct shared *each = all; each && !error; each = each->next)
        if (each->until == queue) show_to_gl(each);
    pthread_mutex_unlock(&lock);
    return error;
}

static cl_int set_kernel_arg(cl_kernel kernel, cl_uint index, size_t size, const void *value)
{
    struct shared *buffer = size == sizeof(cl_mem) && value ? find(*(const cl_mem *)value) : NULL;
    pthread_mutex_lock(&lock);
    forget_arguments(kernel, index, NULL);
    if (buffer) {
        struct argument *made = allocated(sizeof *made);
        *made = (struct argument){kernel, index, buffer, arguments};
        arguments = made;
    }
    pthread_mutex_unlock(&lock);
    return BELOW(clSetKernelArg, cl_int, cl_kernel, cl_uint, size_t, const void *)
    (kernel, index, size, value);
}

static cl_int release_kernel(cl_kernel kernel)
{
    cl_uint references = 0;
    BELOW(clGetKernelInfo, cl_int, cl_kernel, cl_uint, size_t, void *, size_t *)
    (kernel, CL_KERNEL_REFERENCE_COUNT, sizeof references, &references, NULL);
    pthread_mutex_lock(&lock);
    if (references == 1) forget_arguments(kernel, -1, NULL);
    pthread_mutex_unlock(&lock);
    return BELOW(clReleaseKernel, cl_int, cl_kernel)(kernel);
}

static void check_arguments(cl_kernel kernel)
{
    pthread_mutex_lock(&lock);
    for (struct argument *each = arguments; each; each = each->next) {
        if (each->kernel != kernel) continue;
        ++kernel_arguments;
        if (!each->buffer->whole->is_acquired)
            misuse("used by a kernel without being acquired", each->buffer->whole->name, 0);
    }
    pthread_mutex_unlock(&lock);
}

#define CHECKED(our_name, name, result, check, given, ...) \
    static result our_name(__VA_ARGS__) \
    { \
        check; \
        return BELOW(name, result, __VA_ARGS__) given; \
    }
#define EVENTS cl_uint waits, const cl_event *wait_for, cl_event *event
#define GIVEN_EVENTS waits, wait_for, event
CHECKED(launch, clEnqueueNDRangeKernel, cl_int, check_arguments(k),
        (q, k, n, offset, size, group, GIVEN_EVENTS), cl_command_queue q, cl_kernel k, cl_uint n,
        const size_t *offset, const size_t *size, const size_t *group, EVENTS)
CHECKED(read_buffer, clEnqueueReadBuffer, cl_int, check_acquired(m, "read without being acquired"),
        (q, m, blocking, offset, size, to, GIVEN_EVENTS), cl_command_queue q, cl_mem m, cl_uint blocking,
        size_t offset, size_t size, void *to, EVENTS)
CHECKED(write_buffer, clEnqueueWriteBuffer, cl_int, check_acquired(m, "written without being acquired"),
        (q, m, blocking, offset, size, from, GIVEN_EVENTS), cl_command_queue q, cl_mem m, cl_uint blocking,
        size_t offset, size_t size, const void *from, EVENTS)
CHECKED(copy_buffer, clEnqueueCopyBuffer, cl_int,
        (check_acquired(a, "copied from without being acquired"),
         check_acquired(b, "copied to without being acquired")),
        (q, a, b, from, to, size, GIVEN_EVENTS), cl_command_queue q, cl_mem a, cl_mem b, size_t from,
        size_t to, size_t size, EVENTS)
CHECKED(fill_buffer, clEnqueueFillBuffer, cl_int, check_acquired(m, "filled without being acquired"),
        (q, m, pattern, length, offset, size, GIVEN_EVENTS), cl_command_queue q, cl_mem m,
        const void *pattern, size_t length, size_t offset, size_t size, EVENTS)
CHECKED(map_buffer, clEnqueueMapBuffer, void *, check_acquired(m, "mapped without being acquired"),
        (q, m, blocking, flags, offset, size, GIVEN_EVENTS, error), cl_command_queue q, cl_mem m,
        cl_uint blocking, cl_bitfield flags, size_t offset, size_t size, EVENTS, cl_int *error)

/* ---- cl_loader_layers ---- */

cl_int clGetLayerInfo(cl_uint parameter, size_t room, void *value, size_t *needed)
{
    static const cl_uint version = CL_LAYER_API_VERSION_100;
    static const char name[] = "strict cl_khr_gl_sharing for tests";
    size_t size = parameter == CL_LAYER_API_VERSION ? sizeof version : sizeof name;
    if (parameter != CL_LAYER_API_VERSION && parameter != CL_LAYER_NAME) return CL_INVALID_VALUE;
    if (value && room < size) return CL_INVALID_VALUE;
    if (value) memcpy(value, parameter == CL_LAYER_API_VERSION ? (const void *)&version : name, size);
    if (needed) *needed = size;
    return CL_SUCCESS;
}

cl_int clInitLayer(cl_uint count, const function *target, cl_uint *our_count, const function **ours)
{
    if (count < USED_ENTRIES) return CL_INVALID_VALUE;
    function *table = memcpy(allocated(count * sizeof *table), target, count * sizeof *table);
    memcpy(below, target, sizeof below);
    table[clGetDeviceInfo] = (function)device_info;
    table[clCreateContext] = (function)create_context;
    table[clCreateFromGLBuffer] = (function)create_from_gl_buffer;
    table[clCreateSubBuffer] = (function)create_sub_buffer;
    table[clEnqueueAcquireGLObjects] = (function)acquire;
    table[clEnqueueReleaseGLObjects] = (function)release;
    table[clFinish] = (function)finish;
    table[clSetKernelArg] = (function)set_kernel_arg;
    table[clReleaseKernel] = (function)release_kernel;
    table[clEnqueueNDRangeKernel] = (function)launch;
    table[clEnqueueReadBuffer] = (function)read_buffer;
    table[clEnqueueWriteBuffer] = (function)write_buffer;
    table[clEnqueueCopyBuffer] = (function)copy_buffer;
    table[clEnqueueFillBuffer] = (function)fill_buffer;
    table[clEnqueueMapBuffer] = (function)map_buffer;
    atexit(report_counts);
    *our_count = count;
    *ours = table;
    return CL_SUCCESS;
}
