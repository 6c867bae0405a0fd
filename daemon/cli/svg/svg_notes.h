/* SPDX-License-Identifier: MIT
 *
 * svg_notes.h - the notes beside the levels of a picture: events of nodes, hits of rules.
 */
#ifndef CANWIRE_CLI_SVG_SVG_NOTES_H
#define CANWIRE_CLI_SVG_SVG_NOTES_H

#include "config/config.h"

#define NOTE_TEXT_MAX 160 /* bytes with the final 0; longer text is cut off with ... */
#define NOTE_OF_BUS CW_NODES_MAX

/* Kinds of notes, the more important ones last. The last one decides the colour of several
 * simultaneous events. */
typedef enum note_kind {
    NOTE_COUNTERS = 0,
    NOTE_FRAME, /* sent, received */
    NOTE_LOST,  /* arbitration, a frame */
    NOTE_STATE,
    NOTE_OVERLOAD,
    NOTE_ERROR,
    NOTE_FAULT,
    NOTE_KIND_COUNT
} note_kind;

/* A note. Hits of rules stand in the middle of a bit, or at its start; all others at its end. */
typedef struct note {
    size_t half;   /* place in half bits from the start of the picture */
    unsigned node; /* number, or NOTE_OF_BUS */
    note_kind kind;
    char text[NOTE_TEXT_MAX];
} note;

/* The notes of all lanes, each in the order of time. */
typedef struct note_list {
    const cfg *config;
    note *list;
    size_t count;
    size_t capacity;
    size_t bits;                /* taken so far */
    uint64_t end;               /* tick of the end of the last one; at first of the start */
    note pending[CW_NODES_MAX]; /* for the next bit; empty text: none */
    struct {
        cw_state state;
        uint16_t tec;
        uint16_t rec;
    } before[CW_NODES_MAX]; /* at its start */
} note_list;

/* Initialises the notes, between two bits. */
void notes_init(note_list *self, const cfg *config, const cw_bus *bus);

/* Takes each event, before the bit at whose end it came. Returns false without memory. */
bool notes_event(note_list *self, const cw_event *event);

/* Takes each bit, in order. Returns false without memory. */
bool notes_bit(note_list *self, const cw_bit_view *bit);

/* Returns the bit of a note, counted from the start of the picture. */
size_t note_bit(const note *self);

void notes_free(note_list *self);

#endif
