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

/* Opens all ports and starts the bus at bus time 0. The configuration must live longer. NULL after
 * logging why. */
engine *engine_start(struct ev_loop *loop, live *config);

/* Takes no more frames, lets the frame on the wire end, or 1000 bit times pass, then breaks the
 * loop. */
void engine_stop(engine *e);

/* Whether it has ended the loop, or is about to, because it cannot wake up in time any more, as has
 * been logged. */
bool engine_has_failed(const engine *e);

/* Closes the ports. NULL is fine. */
void engine_free(engine *e);

/* Brings the bus up to now; a resting bus is not looked after otherwise. */
void engine_update(engine *e);

/* The bus as far as it has been simulated, to be read only. */
const cw_bus *engine_bus(const engine *e);

/* CLOCK_MONOTONIC at which a tick of the bus is, in ns. It moves when the bus skips time. */
int64_t engine_time_ns(const engine *e, uint64_t tick);

/* The bus, brought up to now, to be changed; engine_update() has to follow. */
inputs *engine_change(engine *e);

/* The same as it is, to look on. */
inputs *engine_inputs(engine *e);

/* Takes over what reload_read() has read; the bus goes over to it at the end of the frame on the
 * wire, or after 1000 bit times. Nodes are matched by name and keep their state and queue; rules
 * begin anew, injected ones are gone. False, with nothing changed, after writing a line per
 * error. */
bool engine_reload(engine *e, reload *r, FILE *errors);

/* Is told when the bus has gone over to another configuration, with the old node for each new one
 * (CW_NO_NODE: none), for reload_remap(); one at most. */
typedef void engine_changed(void *user, const uint8_t from[CW_NODES_MAX]);
void engine_on_change(engine *e, engine_changed *changed, void *user);

/* Is told of each event of the bus; one at most. It must not change the bus. */
typedef void engine_observer(void *user, const cw_event *event);
void engine_observe(engine *e, engine_observer *observer, void *user);

/* Is told of each bit of the bus, after its events; one at most, NULL for none. Every bit is then
 * simulated by itself, which costs time, but for those of an idle bus, which are left out. */
typedef void engine_bit_observer(void *user, const cw_bus *bus);
void engine_observe_bits(engine *e, engine_bit_observer *observer, void *user);

/* Bus time as wall clock (CLOCK_REALTIME), in nanoseconds since 1970. It goes on as bus time
 * does; where somebody sets the clock, or the two have drifted apart by 1 ms, it goes over to
 * the clock. */
uint64_t engine_realtime_ns(const engine *e, uint64_t tick);

/* Counts what ECUs have sent on vcans without loopback, which reaches nobody; once a second is
 * enough. */
void engine_count_loopless(engine *e);

/* What is to be shown beyond the bus itself. */
void engine_report(const engine *e, report *out);

/* Logs an error for each node with frames that are unaccounted for; returns their number. */
unsigned engine_check_books(const engine *e);

#endif
