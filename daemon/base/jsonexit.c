/* SPDX-License-Identifier: MIT
 *
 * jsonexit.c - ends a program that has no memory for JSON.
 */
#include "base/text/jsonput.h"

#include "base/unit.h"

#include <stdlib.h>

static _Noreturn void end_without_memory(void)
{
    fputs("canwire: out of memory\n", stderr);
    exit(unit_failure());
}

void json_no_memory(void)
{
    end_without_memory();
}

/* jansson's calls then never fail, so that nobody has to check them. */
static void *allocate(size_t size)
{
    void *memory = malloc(size);
    if (!memory)
        end_without_memory();
    return memory;
}

void json_must_have_memory(void)
{
    json_set_alloc_funcs(allocate, free);
}
