// An OpenCL driver with one GPU that aborts the process as soon as a context is opened on it.
// Built by test_device_check.py; it needs no OpenCL headers.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FUNCTIONS 256  // more than any version's dispatch table has
enum { SUCCESS = 0, INVALID_VALUE = -30, GPU = 4 };

struct object { void **dispatch; };  // what every handle of a driver begins with
static void *dispatch[FUNCTIONS];
static struct object platform = {dispatch}, device = {dispatch};

static void give_up(void)
{
    fputs("aborting driver: error: no firmware for this GPU\n", stderr);
    abort();
}

static int answer(const void *value, size_t size, size_t room, void *out, size_t *needed)
{
    if (needed) *needed = size;
    if (out && room < size) return INVALID_VALUE;
    if (out) memcpy(out, value, size);
    return SUCCESS;
}

static int text(const char *value, size_t room, void *out, size_t *needed)
{
    return answer(value, strlen(value) + 1, room, out, needed);
}

static int platform_info(void *of, uint32_t name, size_t room, void *out, size_t *needed)
{
    (void)of;
    switch (name) {
    case 0x0900: return text("FULL_PROFILE", room, out, needed);
    case 0x0901: return text("OpenCL 1.2 Fake", room, out, needed);
    case 0x0902: return text("Aborting platform", room, out, needed);
    case 0x0903: return text("Tests", room, out, needed);
    case 0x0904: return text("cl_khr_icd", room, out, needed);
    case 0x0920: return text("ABORT", room, out, needed);
    }
    return INVALID_VALUE;
}

static int device_ids(void *of, uint64_t type, uint32_t room, void **out, uint32_t *count)
{
    (void)of;
    if (!(type & GPU) && type != 0xFFFFFFFF) return -1;
    if (out && room) out[0] = &device;
    if (count) *count = 1;
    return SUCCESS;
}

static int device_info(void *of, uint32_t name, size_t room, void *out, size_t *needed)
{
    const uint64_t type = GPU, bytes = 1 << 30;
    const uint32_t units = 64;
    const void *const own = &platform;
    (void)of;
    switch (name) {
    case 0x1000: return answer(&type, sizeof type, room, out, needed);
    case 0x1002: return answer(&units, sizeof units, room, out, needed);
    case 0x101F: return answer(&bytes, sizeof bytes, room, out, needed);
    case 0x102B: return text("Aborting GPU", room, out, needed);
    case 0x102C: return text("Tests", room, out, needed);
    case 0x102D: return text("1.0", room, out, needed);
    case 0x102E: return text("FULL_PROFILE", room, out, needed);
    case 0x102F: return text("OpenCL 1.2 Fake", room, out, needed);
    case 0x1030: return text("", room, out, needed);
    case 0x1031: return answer(&own, sizeof own, room, out, needed);
    }
    return INVALID_VALUE;
}

int clIcdGetPlatformIDsKHR(uint32_t room, void **out, uint32_t *count)
{
    for (int i = 0; i < FUNCTIONS; ++i) dispatch[i] = (void *)give_up;
    dispatch[1] = (void *)platform_info;
    dispatch[2] = (void *)device_ids;
    dispatch[3] = (void *)device_info;
    if (out && room) out[0] = &platform;
    if (count) *count = 1;
    return SUCCESS;
}

void *clGetExtensionFunctionAddress(const char *name)
{
    if (!strcmp(name, "clIcdGetPlatformIDsKHR")) return (void *)clIcdGetPlatformIDsKHR;
    if (!strcmp(name, "clGetPlatformInfo")) return (void *)platform_info;
    return NULL;
}
