/* SPDX-License-Identifier: MIT
 *
 * engine_rig.h - an engine in real time whose clock is the test's: time passes only when the test
 * lets it.
 */
#ifndef CANWIRE_ENGINE_RIG_H
#define CANWIRE_ENGINE_RIG_H

#include "cases.h"
#include "engine/engine.h"

#include "config/config.h"

#include <time.h>
#include <unistd.h>

#define NS_PER_S INT64_C(1000000000)
#define PATH_BYTES 40

static int64_t clock_now_ns = NS_PER_S;
static void (*at_look)(void); /* called at each look at the monotonic clock; or NULL */

/* Replaces the C library's function for the whole program. */
int clock_gettime(clockid_t id, struct timespec *t)
{
    if (at_look && id == CLOCK_MONOTONIC)
        at_look();
    *t = (struct timespec){.tv_sec = clock_now_ns / NS_PER_S, .tv_nsec = clock_now_ns % NS_PER_S};
    return 0;
}

typedef struct engine_rig {
    struct ev_loop *loop;
    live *live;
    engine *engine;
    unsigned changes; /* of the configuration */
} engine_rig;

static inline void make_file(char path[PATH_BYTES], const char *name)
{
    (void)snprintf(path, PATH_BYTES, "/tmp/canwire-%s-XXXXXX", name);
    int fd = mkstemp(path);
    assert_true(fd >= 0);
    assert_int_equal(close(fd), 0);
}

/* Returns the configuration of a text, which is freed. */
static inline cfg *load_text(char *text)
{
    const cfg_file file = {.name = "test.yaml", .text = text, .size = strlen(text)};
    cfg *config = cfg_load_given(&file, 1, stderr);
    free(text);
    return config;
}

static inline void count_change(void *user, const uint8_t from[CW_NODES_MAX])
{
    (void)from;
    ((engine_rig *)user)->changes++;
}

static inline void engine_rig_start(engine_rig *r, cfg *config)
{
    assert_non_null(config);
    *r = (engine_rig){.loop = ev_loop_new(EVFLAG_AUTO), .live = live_new(config)};
    r->engine = engine_start(r->loop, r->live);
    assert_non_null(r->engine);
    engine_on_change(r->engine, count_change, r);
}

static inline void engine_rig_reload(engine_rig *r, const char *path)
{
    reload *next = reload_read(path, NULL, stderr);
    assert_non_null(next);
    assert_true(engine_reload(r->engine, next, stderr));
}

static inline void engine_rig_end(engine_rig *r)
{
    engine_free(r->engine);
    live_free(r->live);
    ev_loop_destroy(r->loop);
}

#endif
