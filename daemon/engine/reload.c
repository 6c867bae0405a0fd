/* SPDX-License-Identifier: MIT
 *
 * reload.c - prepares another configuration while the bus runs.
 */
#include "engine/reload.h"

#include "base/log.h"
#include "base/mounts.h"
#include "base/file/pathsocket.h"
#include "base/file/spool.h"
#include "base/text/sametext.h"
#include "base/unit.h"
#include "engine/share.h"
#include "port/open.h"
#include "run/bus_make.h"

#include <assert.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

/* ---- Setups ---------------------------------------------------------------------------------- */

/* Reports about replayed files. */
static void reload_report(void *user, bool failed, const char *text)
{
    (void)user;
    if (failed)
        log_error("%s; it is replayed no further", text);
    else
        log_warning("%s", text);
}

bool setup_make(setup *s, const cfg *config)
{
    *s = (setup){.plan = release_plan_new(config, reload_report, NULL)};
    s->bus = bus_make(&s->memory, config);
    return s->bus && s->plan && release_read_ahead(s->plan);
}

void setup_free(setup *s)
{
    for (unsigned i = 0; i < CW_NODES_MAX; i++)
        port_close(s->ports[i]);
    port_close(s->door);
    release_plan_free(s->plan);
    free(s->memory);
    *s = (setup){.memory = NULL};
}

/* ---- Fixed settings -------------------------------------------------------------------------- */

/* Prints the place of a setting; a missing one has the beginning of the file. */
static void print_place(FILE *errors, const cfg *config, cfg_place place)
{
    fprintf(errors, "%s: ", cfg_place_text(config, place).text);
}

/* A setting that a new configuration must not change. */
typedef struct fixed {
    const char *name;
    bool same;
    cfg_place place;
} fixed;

/* Refuses a control socket where the next start could not make it. */
static bool check_control(const cfg *new, const cfg *old, FILE *errors)
{
    char error[PATHSOCKET_ERROR_MAX];
    if (!new->control || same_text(new->control, old->control) ||
        pathsocket_probe(new->control, error))
        return true;
    print_place(errors, new, new->control_place);
    fprintf(errors, "control %s: %s\n", new->control, error);
    return false;
}

/* Returns whether a bus that runs can take a configuration. Complains about each key that must
 * stay. */
static bool can_follow(const cfg *new, const cfg *old, FILE *errors)
{
    const cfg_lcm *lcm = &new->lcm;
    const fixed settings[] = {
        {"bus.name", same_text(new->bus_name, old->bus_name), new->bus_name_place},
        {"bus.bitrate", new->bitrate_bps == old->bitrate_bps, new->bitrate_place},
        {"control", same_text(new->control, old->control), new->control_place},
        {"pacing: virtual",
         (new->pacing == CFG_PACING_VIRTUAL) == (old->pacing == CFG_PACING_VIRTUAL),
         new->virtual_time.place},
        {"virtual.socket", same_text(new->virtual_time.socket, old->virtual_time.socket),
         new->virtual_time.place},
        {"lcm", lcm->enabled == old->lcm.enabled, lcm->place},
        {"lcm.url", same_text(lcm->url, old->lcm.url), lcm->url_place},
    };
    bool good = true;
    for (size_t i = 0; i < sizeof settings / sizeof settings[0]; i++) {
        if (settings[i].same)
            continue;
        print_place(errors, new, settings[i].place);
        fprintf(errors, "%s cannot change while the bus runs: restart canwired\n",
                settings[i].name);
        good = false;
    }
    return good;
}

/* ---- Nodes and ports ------------------------------------------------------------------------- */

/* Returns the node that has the interface, or CW_NO_NODE. Guests share a socket, and have none. */
static uint8_t find_port(const cfg *config, const char *interface)
{
    for (size_t i = 0; i < config->node_count; i++)
        if (config->nodes[i].guest == 0 && same_text(config->nodes[i].port, interface))
            return (uint8_t)i;
    return CW_NO_NODE;
}

/* Opens the port of a node that the old configuration did not have. */
static bool open_port(reload *r, unsigned i, FILE *errors)
{
    char error[PORT_ERROR_TEXT_MAX];
    const cfg_node *node = &r->config->nodes[i];
    if (cfg_waits_for_port(r->config, node) && !port_exists(node->port))
        return true;
    r->setup.ports[i] = port_open(node->port, r->config->bus_name, error);
    if (!r->setup.ports[i]) {
        print_place(errors, r->config, node->port_place);
        fprintf(errors, "node %s: port %s\n", node->name, error);
    }
    share_port(r->setup.ports[i], r->config, i);
    return r->setup.ports[i] != NULL;
}

/* Returns false, after a complaint, when the next start would refuse the port of a node that is
 * missing now. */
static bool may_be_missing(const reload *r, unsigned i, FILE *errors)
{
    const cfg_node *node = &r->config->nodes[i];
    if (cfg_waits_for_port(r->config, node) || port_exists(node->port))
        return true;
    print_place(errors, r->config, node->port_place);
    fprintf(errors, "node %s: port %s: %s\n", node->name, node->port, strerror(ENODEV));
    return false;
}

/* Returns the port of a pending reload: an interface is opened once, so that its port is
 * borrowed. */
static port *borrow_port(const reload *pending, const char *interface)
{
    uint8_t node = pending ? find_port(pending->config, interface) : CW_NO_NODE;
    return node == CW_NO_NODE ? NULL : pending->setup.ports[node];
}

/* Keeps borrowed ports, or returns them. */
static void complete_borrowed(reload *r, reload *pending, bool keep)
{
    for (unsigned i = 0; pending && i < CW_NODES_MAX; i++)
        for (unsigned k = 0; r->setup.ports[i] && k < CW_NODES_MAX; k++)
            if (pending->setup.ports[k] == r->setup.ports[i]) {
                port **loser = keep ? &pending->setup.ports[k] : &r->setup.ports[i];
                *loser = NULL;
                break;
            }
}

/* Matches nodes and ports. A port stays open even if its node gets another name. A second socket on
 * an interface would mistake frames of the first one for frames of the ECU. */
static bool match_nodes(reload *r, const cfg *old, const reload *pending, FILE *errors)
{
    bool good = true;
    cfg_match_nodes(r->from, r->config, old);
    memset(r->port_from, CW_NO_NODE, sizeof r->port_from);
    for (unsigned i = 0; i < r->config->node_count; i++) {
        const cfg_node *node = &r->config->nodes[i];
        if (node->guest > 0)
            r->port_from[i] = r->from[i];
        if (!node->port || node->guest > 0)
            continue;
        r->port_from[i] = find_port(old, node->port);
        if (r->port_from[i] != CW_NO_NODE) {
            good = may_be_missing(r, i, errors) && good;
            continue;
        }
        r->setup.ports[i] = borrow_port(pending, node->port);
        if (!r->setup.ports[i])
            good = open_port(r, i, errors) && good;
    }
    return good;
}

/* Opens the door of the guests. One that is open already, or that of a pending reload, is kept. */
static bool open_door(reload *r, const cfg *old, const reload *pending, FILE *errors)
{
    char error[PORT_ERROR_TEXT_MAX];
    const char *name = cfg_guest_port(r->config);
    const cfg_node *guest = &r->config->nodes[r->config->node_count - 1];
    if (!name || same_text(name, cfg_guest_port(old)))
        return true;
    if (pending && same_text(name, cfg_guest_port(pending->config)))
        r->setup.door = pending->setup.door;
    if (!r->setup.door)
        r->setup.door = door_open(name, error);
    if (r->setup.door)
        return true;
    print_place(errors, r->config, guest->port_place);
    fprintf(errors, "guests: port %s\n", error);
    return false;
}

/* Guests that are there keep the names that their clients have said. */
static bool can_keep_names(const reload *r, const cfg *old, FILE *errors)
{
    bool good = true;
    for (size_t i = old->node_count - old->guest_count; i < old->node_count; i++) {
        const uint8_t other = cfg_find_node(r->config, old->nodes[i].name);
        if (other == CW_NO_NODE || r->config->nodes[other].guest == old->nodes[i].guest)
            continue;
        fprintf(errors, "%s:%d:1: node '%s': a guest of that name is there\n", r->config->file,
                r->config->nodes[other].line, old->nodes[i].name);
        good = false;
    }
    return good;
}

/* Refuses what the start refuses, see recordings_start() and verdicts_start(). */
static bool check_written(const cfg *config, FILE *errors)
{
    fileuses all = {.count = 0};
    cfg_add_files_written(&all, config);
    bool good = !all.incomplete;
    if (!good)
        fprintf(errors, "%s: out of memory\n", config->file);
    for (size_t i = 0; i < all.count; i++) {
        const fileuse *use = &all.uses[i];
        int error = spool_probe(use->path, use->older + 1);
        if (error == 0)
            error = mounts_forecast(use->path);
        if (error == 0 || spool_may_wait(error))
            continue;
        fprintf(errors, "%s:%d:%d: %s %s: %s%s\n", use->file, use->line, use->column, use->what,
                use->path, spool_explain(error), unit_hint(use->path, error));
        good = false;
    }
    fileuses_free(&all);
    return good;
}

reload *reload_read(const char *file, const fileuses *others, FILE *errors)
{
    reload *r = calloc(1, sizeof *r);
    if (!r) {
        fprintf(errors, "%s: out of memory\n", file);
        return NULL;
    }
    r->config = cfg_load_regular(file, errors);
    bool good = r->config && cfg_check_files(r->config, others, "canwired", errors) &&
                check_written(r->config, errors);
    if (good && !setup_make(&r->setup, r->config)) {
        fprintf(errors, "%s: %s\n", file, bus_why_not());
        good = false;
    }
    if (good)
        return r;
    reload_free(r);
    return NULL;
}

bool reload_match(reload *r, const cfg *old, reload *pending, FILE *errors)
{
    bool good = check_control(r->config, old, errors) && can_follow(r->config, old, errors) &&
                can_keep_names(r, old, errors) && match_nodes(r, old, pending, errors) &&
                open_door(r, old, pending, errors);
    complete_borrowed(r, pending, good);
    if (pending && r->setup.door == pending->setup.door)
        *(good ? &pending->setup.door : &r->setup.door) = NULL;
    return good;
}

/* Allocates no memory: a failure would lose the counts. */
void reload_remap(void *array, size_t size, const uint8_t from[CW_NODES_MAX])
{
    unsigned char *elements = array;
    unsigned char old[CW_NODES_MAX * RELOAD_REMAP_BYTES_MAX];
    assert(size <= RELOAD_REMAP_BYTES_MAX);
    memcpy(old, array, CW_NODES_MAX * size);
    memset(array, 0, CW_NODES_MAX * size);
    for (unsigned i = 0; i < CW_NODES_MAX; i++)
        if (from[i] != CW_NO_NODE)
            memcpy(elements + i * size, old + from[i] * size, size);
}

void reload_free(reload *r)
{
    if (!r)
        return;
    setup_free(&r->setup);
    cfg_free(r->config);
    free(r);
}
