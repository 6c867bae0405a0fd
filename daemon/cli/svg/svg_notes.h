/* SPDX-License-Identifier: MIT
 *
 * svg_notes.h - what is written beside the levels of a picture: events of nodes, hits of rules.
 */
#ifndef CANWIRE_CLI_SVG_SVG_NOTES_H
#define CANWIRE_CLI_SVG_SVG_NOTES_H

#include "config/config.h"

#define NOTE_TEXT_MAX 160 /* bytes with the final 0; longer text is cut off with ... */
#define NOTE_OF_BUS CW_NODES_MAX

/* The more important ones last: they give the colour where several things happen at once. */
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

/* Hits of rules stand amid a bit, or at the start of one; all else at the end of one. */
typedef struct note {
    size_t half;   /* where: half bits from the start of the picture */
    unsigned node; /* number, or NOTE_OF_BUS */
    note_kind kind;
    char text[NOTE_TEXT_MAX];
} note;

/* Each lane's in the order of time. */
typedef struct note_list {
    const cfg *config;
    note *list;
    size_t count;
    size_t capacity;
    uint64_t start;             /* tick of the picture */
    note pending[CW_NODES_MAX]; /* of the bit to come; empty text: none */
    struct {
        cw_state state;
        uint16_t tec;
        uint16_t rec;
    } before[CW_NODES_MAX]; /* at its start */
} note_list;

/* Between two bits. */
void notes_init(note_list *self, const cfg *config, const cw_bus *bus);

/* Each event, before the bit at whose end it came. False when there is no memory. */
bool notes_event(note_list *self, const cw_event *event);

/* Each bit, in order. False when there is no memory. */
bool notes_bit(note_list *self, const cw_bit_view *bit);

/* The bit, counted from the start of the picture, that a note belongs to. */
size_t note_bit(const note *self);

void notes_free(note_list *self);

#endif
