/* What all loops on the host share: types, rules of arithmetic, a heap.
 *
 * Rules for equal bits with every compiler and processor: types of exact width; the least and greatest of two as
 * Python has them, never fmin and fmax; signed division and remainder rounded down; hashes unsigned; heaps and
 * sorts by (value, index); square roots, but no other function of libm where results reach a terrain.
 * Arrays are given with their sizes as [rows][columns], northward from the south unless said otherwise.
 */
#pragma once

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#ifdef _WIN32
#define HOST __declspec(dllexport)
#else
#define HOST __attribute__((visibility("default")))
#endif

/* The least and the greatest of two: the first where they are equal or one is not a number. */
static inline double least(double a, double b) { return b < a ? b : a; }
static inline double greatest(double a, double b) { return b > a ? b : a; }
static inline int64_t least_index(int64_t a, int64_t b) { return b < a ? b : a; }
static inline int64_t greatest_index(int64_t a, int64_t b) { return b > a ? b : a; }

/* Quotient and remainder of integers, rounded down; the divisor is positive. */
static inline int64_t floor_divide(int64_t a, int64_t b) { return a / b - (a % b < 0); }
static inline int64_t floor_modulo(int64_t a, int64_t b) { return a % b + (a % b < 0 ? b : 0); }

/* An entry of a heap, lowest first. */
typedef struct {
    double level;
    int64_t index;
} HeapEntry;

static inline bool heap_before(HeapEntry a, HeapEntry b)
{
    return a.level < b.level || (a.level == b.level && a.index < b.index);
}

/* Add an entry to a heap of `count` entries. */
static inline void heap_push(HeapEntry *heap, int64_t *count, double level, int64_t index)
{
    HeapEntry entry = {level, index};
    int64_t at = (*count)++;
    while (at > 0 && heap_before(entry, heap[(at - 1) / 2])) {
        heap[at] = heap[(at - 1) / 2];
        at = (at - 1) / 2;
    }
    heap[at] = entry;
}

/* Remove and return the lowest entry. */
static inline HeapEntry heap_pop(HeapEntry *heap, int64_t *count)
{
    HeapEntry lowest = heap[0], entry = heap[--*count];
    int64_t at = 0;
    for (;;) {
        int64_t child = 2 * at + 1;
        if (child >= *count)
            break;
        child += child + 1 < *count && heap_before(heap[child + 1], heap[child]);
        if (!heap_before(heap[child], entry))
            break;
        heap[at] = heap[child];
        at = child;
    }
    heap[at] = entry;
    return lowest;
}
