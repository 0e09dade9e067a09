/* Functions that fault, each in a place of its own; `node.py` calls them with the number 8. */
#include <stdlib.h>
#include <string.h>

long read_row(long *row) { return row[0] + 1; }

long write_row(long *row) {
    row[0] = 1;
    return row[1];
}

long clear_large(char *start) {
    memset(start, 0, (size_t)start);
    return start[0] + 1;
}

long clear_not_finite(char *start) {
    memset(start, 1, (size_t)start);
    return start[1] + 2;
}

long read_past(size_t size) {
    char *memory = calloc(size, 1);
    long last = memory[size];
    free(memory);
    return last;
}

/* Twenty faults in six places. */
#define PLACE(name)                                                                     \
    long name(long fault) {                                                             \
        switch (fault) {                                                                \
        case 0: return *(volatile long *)8;                                             \
        case 1: return *(volatile long *)16 = fault;                                    \
        case 2: memset((char *)24, 0, (size_t)fault * 8); return *(volatile char *)24;  \
        default: return (long)strlen((char *)fault) + 1;                                \
        }                                                                               \
    }
PLACE(place_0)
PLACE(place_1)
PLACE(place_2)
PLACE(place_3)
PLACE(place_4)
PLACE(place_5)
