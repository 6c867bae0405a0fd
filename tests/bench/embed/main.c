/* SPDX-License-Identifier: MIT
 *
 * main.c - bench_sim WORK UNITS: messages and events by way of libcanwire-sim, as python-can and
 * Bus.take_columns() ask for them. It prints the units that it has done.
 *
 *   virtual  a node offers a frame, and three others wait for it
 *   real     the same, as in real time: up to the present, then up to the expected end
 *   events   an event of a bus, taken as columns
 */
#include "embed/canwire-sim.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NODES 4
#define ROWS 4096

/* A bus as the interface of python-can makes it: nodes that are not in use are off the bus. */
static const char channel[] =
    "{ bus: { bitrate: 500000, dbitrate: 2000000 }, nodes: [ { name: listener } ],"
    " guests: { count: 62, port: \"unix:bench.sock\" } }";
static const char traffic[] =
    "{ bus: { bitrate: 500000 }, nodes: ["
    " { name: a, traffic: [ { send: 123#DEADBEEF, every: 500us } ] }, { name: b },"
    " { name: c, traffic: [ { send: 321#11, every: 700us } ] }, { name: d } ] }";

static void bench_require(int good, const char *what)
{
    if (good)
        return;
    fprintf(stderr, "bench_sim: %s\n", what);
    exit(1);
}

static canwire_sim *open_bus(const char *text)
{
    char *messages;
    canwire_sim *sim = canwire_sim_load_text(text, strlen(text), "bench.yaml", &messages);
    bench_require(sim != NULL, messages);
    return sim;
}

/* Takes the frame at a node. Waits for it by the time of the bus or, with `real`, up to `now`. A
 * program has waited so far by its own clock, since no frame may come before. */
static void receive(canwire_sim *sim, int node, int real, int64_t now)
{
    canwire_sim_waited waited;
    int64_t until = real ? now : CANWIRE_SIM_NEVER;
    int found;
    while ((found = canwire_sim_wait(sim, node, until, 1000000, &waited)) == 0 && real)
        until = waited.next + 57000; /* the timer of a program is late */
    bench_require(found == 1, canwire_sim_message(sim));
}

static long bench_messages(long units, int real)
{
    canwire_sim *sim = open_bus(channel);
    bench_require(canwire_sim_keep_events(sim, "none") == CANWIRE_SIM_OK, "events");
    for (int node = 1; node <= NODES; node++) {
        bench_require(canwire_sim_attach(sim, node, 1) == CANWIRE_SIM_OK, "attach");
        canwire_sim_listen(sim, node, CANWIRE_SIM_LISTEN_RX | CANWIRE_SIM_LISTEN_ERRORS);
    }
    (void)canwire_sim_run(sim, 1000000, NULL, CANWIRE_SIM_NO_NODE);
    for (long i = 0; i < units; i++) {
        const int sender = 1 + (int)(i % NODES);
        const int64_t now = canwire_sim_now(sim) + 13000;
        canwire_sim_frame frame = {.can_id = (uint32_t)(i * 37 % 0x800), .length = 8};
        memcpy(frame.data, &i, sizeof i);
        bench_require(canwire_sim_offer(sim, sender, &frame, real ? now : 0) == 1, "offer");
        for (int node = 1; node <= NODES; node++)
            if (node != sender)
                receive(sim, node, real, now + 12000);
    }
    canwire_sim_free(sim);
    return units;
}

static long bench_events(long units)
{
    static int64_t t[ROWS];
    static int16_t node[ROWS];
    static uint8_t event[ROWS], data[8 * ROWS];
    static uint32_t can_id[ROWS];
    const canwire_sim_columns columns = {.t = t, .node = node, .event = event, .can_id = can_id,
                                         .data = data, .data_size = 8};
    canwire_sim *sim = open_bus(traffic);
    char *rules;
    long done = 0;
    for (int64_t end = 0; done < units;) {
        end += 100000000;
        bench_require(canwire_sim_run(sim, end, NULL, CANWIRE_SIM_NO_NODE) >= 0, "run");
        done += (long)canwire_sim_take_columns(sim, &columns, ROWS, &rules);
    }
    canwire_sim_free(sim);
    return done;
}

int main(int argc, char **argv)
{
    const long units = argc == 3 ? strtol(argv[2], NULL, 10) : 0;
    long done = 0;
    if (units > 0 && strcmp(argv[1], "virtual") == 0)
        done = bench_messages(units, 0);
    else if (units > 0 && strcmp(argv[1], "real") == 0)
        done = bench_messages(units, 1);
    else if (units > 0 && strcmp(argv[1], "events") == 0)
        done = bench_events(units);
    bench_require(done > 0, "usage: bench_sim virtual|real|events UNITS");
    printf("%ld\n", done);
    return 0;
}
