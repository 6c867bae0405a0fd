/* SPDX-License-Identifier: MIT
 *
 * try.c - tries a configuration: it is checked and run, and a running bus changes to it. A rig is
 * checked.
 */
#include "mutants.h"

#include "config/config.h"
#include "config/rig.h"
#include "engine/reload.h"
#include "engine/share.h"
#include "port/open.h"
#include "record/output.h"
#include "run/inputs.h"
#include "run/live.h"
#include "run/release.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define BITS 20000u        /* of a run */
#define BITS_BETWEEN 3000u /* two reloads */
#define RELEASES_MAX 5000u

/* A bus in virtual time with all that it needs, as in canwired. */
typedef struct world {
    live *live;
    setup setup;
    inputs inputs;
    FILE *out; /* events */
} world;

/* ---- Ports, which need a kernel in earnest --------------------------------------------------- */

bool port_exists(const char *name)
{
    (void)name;
    return true;
}

port *port_open(const char *name, const char *bus, char error[PORT_ERROR_TEXT_MAX])
{
    (void)bus;
    (void)error;
    return (port *)strdup(name);
}

void share_port(port *p, const cfg *config, unsigned node)
{
    (void)p;
    (void)config;
    (void)node;
}

port *door_open(const char *name, char error[PORT_ERROR_TEXT_MAX])
{
    (void)error;
    return (port *)strdup(name);
}

void port_close(port *p)
{
    free(p);
}

/* ---- Messages -------------------------------------------------------------------------------- */

/* Returns true for a line with FILE:LINE:COLUMN:. */
static bool has_place(const char *line, const char *end)
{
    for (; line < end; line++) {
        unsigned at = 0;
        unsigned column = 0;
        int used = 0;
        if (sscanf(line, ":%u:%u: %n", &at, &column, &used) == 2 && used > 0)
            return at > 0 && column > 0;
    }
    return false;
}

static void check_messages(const trial *t, const char *messages, bool good)
{
    bool placed = false;
    if (good != (*messages == '\0'))
        fail(good ? "good, with messages" : "refused without a word", messages);
    for (const char *line = messages; *line;) {
        const char *end = strchr(line, '\n');
        if (!end || strncmp(line, t->folder, strlen(t->folder)) != 0)
            fail("not a line that begins with a file", line);
        placed = placed || has_place(line, end);
        line = end + 1;
    }
    if (!good && !placed)
        fail("refused without FILE:LINE:COLUMN", messages);
}

typedef struct messages {
    char *text;
    size_t size;
    FILE *out;
} messages;

static void begin_messages(messages *m)
{
    m->out = open_memstream(&m->text, &m->size);
    if (!m->out)
        fail("out of memory", "");
}

static void end_messages(const trial *t, messages *m, bool good)
{
    (void)fclose(m->out);
    check_messages(t, m->text, good);
    free(m->text);
}

/* ---- Check ----------------------------------------------------------------------------------- */

static bool check(const trial *t, const char *file)
{
    messages m;
    cfg *config = NULL;
    size_t rules;
    begin_messages(&m);
    bool good = cfg_check(&config, &rules, file, m.out);
    end_messages(t, &m, good);
    cfg_free(config);
    return good;
}

static bool check_rig(const trial *t)
{
    messages m;
    begin_messages(&m);
    rig *found = rig_load(t->config, m.out);
    end_messages(t, &m, found != NULL);
    rig_free(found);
    return found != NULL;
}

/* ---- Runs ------------------------------------------------------------------------------------ */

static void drain(void *user)
{
    world *w = user;
    cw_event event;
    while (cw_bus_poll(w->inputs.bus, &event))
        output_event(w->out, live_config(w->live), &event);
}

static void open_world(world *w, cfg *config)
{
    w->out = fopen("/dev/null", "we");
    w->live = live_new(config);
    if (!w->out || !w->live || !setup_make(&w->setup, config))
        fail("a configuration that is good makes no bus", "");
    inputs_init(&w->inputs, w->live, w->setup.bus, drain, w);
}

static void check_books(const world *w)
{
    for (unsigned i = 0; i < live_config(w->live)->node_count; i++) {
        cw_node_stats stats;
        if (cw_node_get_stats(w->inputs.bus, i, &stats) != CW_OK || !cw_node_stats_balance(&stats))
            fail("frames are lost", live_config(w->live)->nodes[i].name);
    }
}

static void close_world(world *w)
{
    check_books(w);
    output_stats(w->out, live_config(w->live), w->inputs.bus);
    setup_free(&w->setup);
    live_free(w->live);
    (void)fclose(w->out);
}

static void run(world *w, uint64_t bits)
{
    const uint64_t bit = cw_rate_ticks(live_config(w->live)->rate, 1);
    uint64_t end = cw_bus_tick_after(w->inputs.bus, bits);
    release_plan *plan = w->setup.plan;
    release_look(plan, w->inputs.bus);
    for (unsigned i = 0; i < RELEASES_MAX && release_next_tick(plan) <= end; i++) {
        if (inputs_release(&w->inputs, plan) == CW_FULL)
            inputs_advance(&w->inputs, cw_bus_inbox_first(w->inputs.bus) + bit);
        release_look(plan, w->inputs.bus);
    }
    inputs_advance(&w->inputs, end);
}

/* Changes the configuration as engine/go_over.c does. */
static void go_over(world *w, reload *r)
{
    const uint64_t now = cw_bus_now(w->inputs.bus);
    if (inputs_take_over(&w->inputs, r->setup.bus, r->config, r->from, now) != CW_OK)
        fail("the bus does not go over", r->config->file);
    for (unsigned i = 0; i < r->config->node_count; i++)
        if (r->port_from[i] != CW_NO_NODE) {
            r->setup.ports[i] = w->setup.ports[r->port_from[i]];
            w->setup.ports[r->port_from[i]] = NULL;
        }
    release_take_over(r->setup.plan, w->setup.plan, r->from, now);
    setup_free(&w->setup);
    w->setup = r->setup;
    r->setup = (setup){.memory = NULL};
    live_replace(w->live, r->config);
    r->config = NULL;
    reload_free(r);
}

/* Returns true when the bus has changed its configuration. Changes that are impossible at run time
 * are refused. */
static bool reload_world(const trial *t, world *w)
{
    messages m;
    begin_messages(&m);
    reload *r = reload_read(live_config(w->live)->file, NULL, m.out);
    if (r && !reload_match(r, live_config(w->live), NULL, m.out)) {
        reload_free(r);
        r = NULL;
    }
    end_messages(t, &m, r != NULL);
    if (r)
        go_over(w, r);
    run(w, BITS_BETWEEN);
    return r != NULL;
}

/* ---- Files ----------------------------------------------------------------------------------- */

static void write_file(const char *path, const char *text, size_t size)
{
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (fd < 0 || write(fd, text, size) != (ssize_t)size)
        fail("cannot write", path);
    (void)close(fd);
}

static cfg *load(const trial *t)
{
    messages m;
    begin_messages(&m);
    cfg *config = cfg_load(t->config, m.out);
    end_messages(t, &m, config != NULL);
    return config;
}

static void try_run(const trial *t)
{
    world w;
    cfg *config = load(t);
    if (!config)
        return;
    open_world(&w, config);
    run(&w, BITS);
    close_world(&w);
}

static void try_reload(const trial *t, const char *text, size_t size)
{
    world w;
    write_file(t->mutated, t->whole, t->whole_size);
    cfg *config = load(t);
    if (!config)
        fail("the whole file is not good", t->config);
    open_world(&w, config);
    run(&w, BITS_BETWEEN);
    write_file(t->mutated, text, size);
    bool gone = reload_world(t, &w);
    write_file(t->mutated, t->whole, t->whole_size);
    if (!reload_world(t, &w) && gone)
        fail("the bus does not come back", t->config);
    close_world(&w);
}

bool try_files(const trial *t, const char *text, size_t size)
{
    write_file(t->mutated, text, size);
    if (t->is_rig)
        return check_rig(t);
    if (t->mutated != t->config)
        (void)check(t, t->mutated);
    bool good = check(t, t->config);
    try_run(t);
    try_reload(t, text, size);
    return good;
}
