/* SPDX-License-Identifier: MIT
 *
 * engine.h - the bus in real time: it owns the bus, its ports and its timer, in a libev loop.
 */
#ifndef CANWIRE_ENGINE_ENGINE_H
#define CANWIRE_ENGINE_ENGINE_H

#include "engine/reload.h"
#include "engine/report.h"
#include "port/port.h"
#include "run/inputs.h"
#include "run/live.h"

#include <ev.h>

typedef struct engine engine;

/* Opens all ports and starts the bus at bus time 0. The configuration must live longer. Returns
 * NULL after logging the reason. */
engine *engine_start(struct ev_loop *loop, live *config);

/* Takes no more frames, waits for the end of the frame on the wire, or 1000 bit times, then breaks
 * the loop. */
void engine_stop(engine *e);

/* Returns true when it has ended the loop, or is about to, because it can no longer wake up in
 * time. The reason has been logged. */
bool engine_has_failed(const engine *e);

/* Closes the ports. NULL is allowed. */
void engine_free(engine *e);

/* Advances the bus to the present; a resting bus is not simulated otherwise. */
void engine_update(engine *e);

/* Returns the bus as far as it has been simulated, to be read only. */
const cw_bus *engine_bus(const engine *e);

/* Returns the time of a tick by CLOCK_MONOTONIC, in ns. It moves when the bus skips time. */
int64_t engine_time_ns(const engine *e, uint64_t tick);

/* Returns the bus, advanced to the present, for changes; engine_update() has to follow. */
inputs *engine_change(engine *e);

/* Returns the bus without advancing it, to be read only. */
inputs *engine_inputs(engine *e);

/* Takes over the result of reload_read(). The bus changes to it at the end of the frame on the
 * wire, or after 1000 bit times. Nodes are matched by name and keep their state and queue. Rules
 * start afresh, and injected ones are removed. Returns false, with nothing changed, after writing a
 * line per error. */
bool engine_reload(engine *e, reload *r, FILE *errors);

/* Reports that the bus has changed to another configuration. `from` has the old node for each new
 * one (CW_NO_NODE: none), for reload_remap(). There is one observer at most. */
typedef void engine_changed(void *user, const uint8_t from[CW_NODES_MAX]);
void engine_on_change(engine *e, engine_changed *changed, void *user);

/* Reports each event of the bus. There is one observer at most; it must not change the bus. */
typedef void engine_observer(void *user, const cw_event *event);
void engine_observe(engine *e, engine_observer *observer, void *user);

/* Selects kinds of events that are reported besides CW_EVENTS_USUAL and those of the configuration,
 * see cw_bus_set_events(). */
void engine_set_events(engine *e, uint32_t kinds);

/* Reports each bit of the bus, after its events. There is one observer at most, NULL for none.
 * Every bit is then simulated by itself, which costs time; bits of an idle bus are left out. */
typedef void engine_bit_observer(void *user, const cw_bus *bus);
void engine_observe_bits(engine *e, engine_bit_observer *observer, void *user);

/* Returns bus time as wall clock (CLOCK_REALTIME), in nanoseconds since 1970. It advances with bus
 * time. It adopts the clock when somebody sets it, or when the two differ by 1 ms. */
uint64_t engine_realtime_ns(const engine *e, uint64_t tick);

/* Counts frames that ECUs have sent on vcans without loopback, which reach no receiver; once a
 * second is enough. */
void engine_count_loopless(engine *e);

/* Fills in the report beyond the bus itself. */
void engine_report(const engine *e, report *out);

/* Logs an error for each node with unaccounted frames; returns their number. */
unsigned engine_check_books(const engine *e);

#endif
