/* SPDX-License-Identifier: MIT
 *
 * turns.c - the order in which programs run in virtual time.
 */
#include "engine/turns.h"

#include <string.h>

/* ---- Order ----------------------------------------------------------------------------------- */

/* Puts programs into an order that is the same in each run. */
static int turns_compare(const turn *a, const turn *b)
{
    if (a->node != b->node)
        return a->node < b->node ? -1 : 1;
    const int words = strncmp(a->program, b->program, sizeof a->program);
    if (words != 0)
        return words;
    return a->came < b->came ? -1 : a->came > b->came;
}

/* ---- Coming and going ------------------------------------------------------------------------ */

unsigned turns_add(turns *t, unsigned node, const timing_join *join)
{
    unsigned place = 0;
    while (place < TURNS_MAX && t->all[place].state != TURN_NONE)
        place++;
    if (place == TURNS_MAX)
        return TURNS_NONE;
    t->all[place] = (turn){.state = TURN_WAITS,
                           .node = node,
                           .came = t->came++,
                           .pid = join->pid,
                           .until_ns = TIMING_NEVER,
                           .ready = true};
    memcpy(t->all[place].ancestors, join->ancestors, sizeof join->ancestors);
    memcpy(t->all[place].program, join->program, sizeof join->program);
    t->count++;
    return place;
}

void turns_remove(turns *t, unsigned place)
{
    t->all[place] = (turn){.state = TURN_NONE};
    t->count--;
}

/* ---- Waiting --------------------------------------------------------------------------------- */

void turns_wait(turns *t, unsigned place, int64_t until_ns, unsigned wants)
{
    turn *one = &t->all[place];
    one->state = TURN_WAITS;
    one->until_ns = until_ns;
    one->wants = wants;
    one->ready = false;
}

void turns_wait_for_children(turns *t, unsigned place)
{
    turns_wait(t, place, TIMING_NEVER, 0);
    t->all[place].state = TURN_CHILDREN;
}

void turns_cancel(turns *t, unsigned place)
{
    turn *one = &t->all[place];
    if (one->state != TURN_WAITS && one->state != TURN_CHILDREN)
        return; /* its turn has begun meanwhile */
    one->state = TURN_WAITS;
    one->ready = true;
}

/* Returns true when the process is an ancestor of the program. Only the nearest ones are known. */
static bool descends(const turn *one, int pid)
{
    for (unsigned i = 0; i < TIMING_ANCESTORS && one->ancestors[i] != 0; i++)
        if (one->ancestors[i] == pid)
            return true;
    return false;
}

static bool has_ancestor_of(const turn *one, const turn *other)
{
    return one->pid == other->pid || descends(one, other->pid) || descends(other, one->pid);
}

static const turn *turns_find(const turns *t, int pid)
{
    for (unsigned i = 0; i < TURNS_MAX; i++)
        if (t->all[i].state != TURN_NONE && t->all[i].pid == pid)
            return &t->all[i];
    return NULL;
}

void turns_told(turns *t, int pid, unsigned what)
{
    const turn *told = turns_find(t, pid);
    for (unsigned i = 0; i < TURNS_MAX; i++) {
        turn *one = &t->all[i];
        if (one->state != TURN_WAITS || !(one->wants & what))
            continue;
        if (pid == 0 || (told ? has_ancestor_of(one, told) : descends(one, pid)))
            one->ready = true;
    }
}

/* ---- Turns ----------------------------------------------------------------------------------- */

/* Returns true when a program of virtual time descends from the process, which may wait for it
 * then. */
static bool has_descendant(const turns *t, int pid)
{
    for (unsigned i = 0; i < TURNS_MAX; i++)
        if (t->all[i].state != TURN_NONE && descends(&t->all[i], pid))
            return true;
    return false;
}

static bool holds(const turns *t, const turn *one)
{
    return one->state == TURN_RUNS || one->state == TURN_ENDS ||
           (one->state == TURN_CHILDREN && !has_descendant(t, one->pid));
}

bool turns_all_wait(const turns *t)
{
    for (unsigned i = 0; i < TURNS_MAX; i++)
        if (holds(t, &t->all[i]))
            return false;
    return true;
}

static bool is_ready(const turn *one, int64_t now_ns)
{
    return one->state == TURN_WAITS && (one->ready || one->until_ns <= now_ns);
}

/* Returns the first one that is ready, and behind the one given (NULL: any). */
static unsigned first(const turns *t, int64_t now_ns, const turn *behind)
{
    unsigned found = TURNS_NONE;
    for (unsigned i = 0; i < TURNS_MAX; i++) {
        const turn *one = &t->all[i];
        if (!is_ready(one, now_ns) || (behind && turns_compare(one, behind) <= 0))
            continue;
        if (found == TURNS_NONE || turns_compare(one, &t->all[found]) < 0)
            found = i;
    }
    return found;
}

unsigned turns_begin(turns *t, int64_t now_ns)
{
    unsigned next = t->round ? first(t, now_ns, &t->last) : TURNS_NONE;
    if (next == TURNS_NONE)
        next = first(t, now_ns, NULL);
    if (next == TURNS_NONE)
        return next;
    t->all[next].state = TURN_RUNS;
    t->last = t->all[next];
    t->round = true;
    return next;
}

int64_t turns_next_ns(const turns *t)
{
    int64_t next_ns = TIMING_NEVER;
    for (unsigned i = 0; i < TURNS_MAX; i++)
        if (t->all[i].state == TURN_WAITS && t->all[i].until_ns < next_ns)
            next_ns = t->all[i].until_ns;
    return next_ns;
}

void turns_go_on(turns *t)
{
    t->round = false;
}
