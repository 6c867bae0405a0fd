/* SPDX-License-Identifier: MIT
 *
 * ownership.c - what the program that is a node's controller has set, and what it is told.
 */
#include "engine/core.h"

#include "base/log.h"

#include <string.h>

/* Changes the settings of a node, all or none. Returns false with the reason. */
static bool ownership_set(engine *e, unsigned node, const char *text,
                          char problem[SETTINGS_ERROR_MAX])
{
    cw_settings settings = {.which = 0};
    cfg_retime time = {.given = 0};
    char of_time[RETIME_PROBLEM_MAX] = "";
    json_error_t error;
    json_t *object = json_loads(text, JSON_REJECT_DUPLICATES, &error);
    const bool read =
        json_is_object(object) && settings_from_json(&settings, &time, problem, object);
    if (!json_is_object(object))
        (void)snprintf(problem, SETTINGS_ERROR_MAX, "the settings are no JSON object");
    json_decref(object);
    if (!read)
        return false;
    if (!cfg_stops_schedule(&e->config->nodes[node], &settings) &&
        inputs_set_all(&e->inputs, of_time, node, &settings, &time) == CW_OK)
        return true;
    (void)snprintf(problem, SETTINGS_ERROR_MAX, "%s",
                   *of_time ? of_time : "the bus does not take these settings");
    return false;
}

bool engine_set_or_say(engine *e, unsigned node, const char *text,
                       char problem[SETTINGS_ERROR_MAX])
{
    *problem = '\0';
    if (*text == '\0' || ownership_set(e, node, text, problem))
        return true;
    log_node_warning(e->config->nodes[node].name, "its controller asks for %s: %s", text, problem);
    return false;
}

void engine_keep_settings(engine *e, unsigned node)
{
    char problem[SETTINGS_ERROR_MAX];
    const port *p = e->now.ports[node];
    if (port_has_controller(p) && e->links.state[node] == REPORT_LINK_UP)
        (void)engine_set_or_say(e, node, port_settings(p), problem);
}

/* ---- The state ------------------------------------------------------------------------------- */

static bool has_nothing_to_send(const cw_node_stats *stats)
{
    return stats->queue == 0 && stats->inbox == 0 && stats->held == 0;
}

/* The bus may be further than an event by now. So a state is told when its event comes; only a node
 * that comes or goes has none. The counters of a frame are those of now. */
void engine_tell_state(const engine *e, unsigned node, const cw_event *event)
{
    cw_node_stats stats;
    port *p = e->now.ports[node];
    message_state state = port_told_state(p);
    if (cw_node_get_stats(e->now.bus, node, &stats) != CW_OK)
        return;
    const bool of_event = event->kind == CW_EVENT_STATE || event->kind == CW_EVENT_ERROR;
    state.tec = of_event ? event->tec : stats.tec;
    state.rec = of_event ? event->rec : stats.rec;
    if (event->kind == CW_EVENT_STATE || event->kind == CW_EVENT_LINK)
        state.state = event->kind == CW_EVENT_STATE ? event->state : stats.state;
    port_tell_state(p, &state);
}

void engine_settle(const engine *e, unsigned node, const cw_event *event)
{
    cw_node_stats stats;
    const bool last = event->kind == CW_EVENT_TX || event->kind == CW_EVENT_DROP;
    if (last && cw_node_get_stats(e->now.bus, node, &stats) == CW_OK && has_nothing_to_send(&stats))
        port_settle(e->now.ports[node]);
}
