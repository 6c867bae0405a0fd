/* SPDX-License-Identifier: MIT
 *
 * vcd.h - the bits of a bus as a Value Change Dump, for GTKWave, PulseView and sigrok.
 *
 * Variables, in a scope named as the bus (1 is recessive, as at the RXD pin of a transceiver):
 *
 *   wire               level; where the bus is partitioned, of all its wires together
 *   fault              1 in bits in which a rule hits, or changes a level
 *   rule               text: the rules that hit in this bit, with + between them
 *   NODE.driven        what the node puts onto its wire
 *   NODE.sampled       what its controller takes
 *   NODE.stuff         1 in a bit that the node takes for a stuff bit
 *   NODE.field         text: see bit_part_print()
 *   NODE.error         text: type of the error that the node detects in this bit
 *   NODE.state         text: error-active ... bus-off
 *   NODE.tec NODE.rec  whole numbers, of type real
 *
 * If nodes have clocks of their own, driven, sampled and wire change at their true times. The unit
 * of time is 100 ps then, and there are also these variables, which stand still in idle time:
 *
 *   NODE.tq            changes with each time quantum
 *   NODE.sample        1 from the sample point to the next quantum
 *   NODE.sync          text: hard or resync, from there to the next quantum
 *   NODE.phase_error   of the last resynchronisation, in quanta, of type real
 *
 * Each bit has its own length on a bus with a data rate whose nodes agree in all their bits (D10).
 * There are no such variables then. While nodes fall out of step there, driven, sampled and wire
 * change at their true times, rounded down to a unit.
 *
 * Only changes are written, so idle time costs nothing. The unit of time is the coarsest that
 * divides all bits into ten or more: sigrok unfolds the file to a sample for each unit.
 *
 * Nothing here fails by itself but for lack of memory; the caller looks at ferror(out).
 */
#ifndef CANWIRE_RECORD_VCD_H
#define CANWIRE_RECORD_VCD_H

#include "canwire.h"
#include "config/config.h"

#include <stdio.h>

typedef struct vcd vcd;

/* Begins a dump of the later bits of a bus, between two bits: it writes the header and notes states
 * and counters. Names of nodes and rules come from config, which must stay in place. Rules may
 * change, but another dump is needed when nodes or the bit rate change. The caller keeps `out`.
 * Returns NULL without memory, with nothing written. */
vcd *vcd_open(FILE *out, const cfg *config, const cw_bus *bus);

/* Takes each event, before the bit at whose end it came. */
void vcd_event(vcd *self, const cw_event *event);

/* Takes each bit, in order. Nothing changes in bits that are left out. */
void vcd_bit(vcd *self, const cw_bit_view *bit);

/* Writes the buffered text to the stream. */
void vcd_flush(vcd *self);

/* Writes the end of the last bit and frees the dump. NULL is allowed. */
void vcd_close(vcd *self);

#endif
