/* SPDX-License-Identifier: MIT
 *
 * go_over.c - changes the running bus to another configuration.
 */
#include "base/text/counted.h"
#include "engine/core.h"

#include "base/log.h"
#include "engine/share.h"

#include <inttypes.h>

/* Logs the frames that removed nodes still had to send. */
static void log_removed(const engine *e)
{
    cw_node_stats stats;
    for (unsigned i = 0; i < e->config->node_count; i++)
        if (cw_node_get_stats(e->now.bus, i, &stats) == CW_OK &&
            stats.dropped[CW_DROP_REMOVED] > 0)
            log_node_warning(e->config->nodes[i].name, "%" PRIu64 " dropped, it is no more",
                             stats.dropped[CW_DROP_REMOVED]);
}

/* Keeps ports that both configurations have, with all that waits in them. */
static void keep_ports(setup *old, reload *r)
{
    if (cfg_guest_port(r->config) && !r->setup.door) {
        r->setup.door = old->door;
        old->door = NULL;
    }
    for (unsigned i = 0; i < r->config->node_count; i++) {
        uint8_t from = r->port_from[i];
        if (from == CW_NO_NODE)
            continue;
        r->setup.ports[i] = old->ports[from];
        old->ports[from] = NULL;
        share_port(r->setup.ports[i], r->config, i);
    }
}

/* Moves the counts: every port ends with its old node and begins with its new one, perhaps the
 * same. */
static void carry_books_over(engine *e, const reload *r)
{
    for (unsigned i = 0; i < e->config->node_count; i++)
        conserve_closing(&e->books, i, e->now.ports[i]);
    conserve_remap(&e->books, r->from);
    for (unsigned i = 0; i < r->config->node_count; i++)
        if (r->port_from[i] != CW_NO_NODE)
            conserve_opened(&e->books, i, e->now.ports[r->port_from[i]]);
}

/* Goes over to the new configuration at the end of a frame. State, queues and ports go with it. */
static void go_over_go_over(engine *e)
{
    reload *r = e->next;
    e->next = NULL;
    if (inputs_take_over(&e->inputs, r->setup.bus, r->config, r->from,
                         e->released + 1) != CW_OK) {
        log_error("%s: the bus cannot go over to the new configuration", r->config->file);
        reload_free(r);
        return;
    }
    log_removed(e);
    for (unsigned i = 0; i < e->config->node_count; i++)
        engine_unwatch_port(e, i);
    carry_books_over(e, r);
    engine_unwatch_door(e);
    keep_ports(&e->now, r);
    release_take_over(r->setup.plan, e->now.plan, r->from, e->released + 1);
    setup_free(&e->now);
    e->now = r->setup;
    r->setup = (setup){.memory = NULL};
    live_replace(e->live, r->config);
    r->config = NULL;
    engine_read_limits(e);
    engine_choose_events(e);
    reload_remap(e->arrived, sizeof e->arrived[0], r->from);
    reload_remap(e->overflowed, sizeof e->overflowed[0], r->from);
    e->ticking = false;
    e->pushed_back = 0;
    for (unsigned i = 0; i < e->config->node_count; i++)
        engine_watch_port(e, i);
    e->guests.gone = 0; /* the next look finds them again */
    engine_watch_door(e);
    engine_carry_links_over(e, r);
    log_warnings(e->config->warnings);
    log_info("%s: configuration reloaded, %s", e->config->bus_name,
             counted(e->config->node_count, "node").text);
    if (e->group_calls)
        e->group_calls->moved(e, r->from);
    if (e->changed)
        e->changed(e->changed_user, r->from);
    reload_free(r);
}

/* Advances bit by bit to the present until a frame ends; then changes to the pending configuration.
 * Many releases may need several wake-ups. */
void engine_run_to_boundary(engine *e, uint64_t now)
{
    while (e->next) {
        if (cw_bus_idle(e->now.bus) || cw_bus_now(e->now.bus) >= e->next->deadline) {
            go_over_go_over(e);
            return;
        }
        uint64_t end = cw_bus_tick_after(e->now.bus, 1);
        if (end > now || engine_run_to(e, end) < end)
            return;
    }
}

bool engine_reload(engine *e, reload *r, FILE *errors)
{
    if (e->stopping) {
        fprintf(errors, "%s: canwired is stopping\n", e->config->file);
        reload_free(r);
        return false;
    }
    e->wake(e);
    if ((e->group_calls && !e->group_calls->may_take(e, r->config, errors)) ||
        !reload_match(r, e->config, e->next, errors)) {
        reload_free(r);
        return false;
    }
    r->deadline = e->next ? e->next->deadline
                          : cw_bus_tick_after(e->now.bus, BOUNDARY_BITS);
    reload_free(e->next);
    e->next = r;
    e->wake(e);
    return true;
}
