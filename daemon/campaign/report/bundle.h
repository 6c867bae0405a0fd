/* SPDX-License-Identifier: MIT
 *
 * bundle.h - the documents of a scenario, from which items can be left out: a bus, or a rig and
 * its buses.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_BUNDLE_H
#define CANWIRE_CAMPAIGN_REPORT_BUNDLE_H

#include "campaign/report/outline.h"
#include "config/rig.h"

/* A bus of a rig. */
typedef struct bundle_bus {
    char *written; /* the name of its file, as the rig writes it */
    char *file;    /* ... and where it is */
    char *moved;   /* ... and next to a rig in another folder */
    size_t item;   /* in the list of the rig */
    outline outline;
} bundle_bus;

/* All zeros is an empty one. */
typedef struct bundle {
    char *file; /* of the main document */
    outline main;
    size_t bus_count; /* 0: the main document is a bus */
    bundle_bus buses[RIG_BUSES_MAX];
} bundle;

/* The texts of the documents, without what is left out. */
typedef struct bundle_text {
    char *main;
    size_t count;
    cfg_file buses[RIG_BUSES_MAX]; /* of a rig; names and texts are owned */
} bundle_text;

/* Reads a text with the name of a file, and the files of its buses. Returns false when it
 * is neither a bus nor a rig that can be read; free it in any case. */
bool bundle_load(bundle *b, const char *file, const char *text, size_t size);

/* Returns document i, from 0 on: the main one, then those of buses; NULL: there are no more, or
 * (*gone) the bus is left out. */
outline *bundle_document(bundle *b, size_t i, bool *gone);

/* Returns the items of a kind that are not left out. */
size_t bundle_count(const bundle *b, outline_kind kind);

/* Writes the texts. moved: for another folder, where the buses are next to the rig, and other files
 * are where they are. Returns false when one has no text. Free them in any case. */
bool bundle_write(bundle_text *out, const bundle *b, bool without_faults, bool moved);

/* Returns true when a rig has one bus left, and no gateway. */
bool bundle_is_single(const bundle *b);

/* Makes the scenario of a single bus out of such a rig, which has then no document of it. */
void bundle_promote(bundle *single, bundle *several);

/* Takes this back; `single` is then empty. */
void bundle_demote(bundle *single, bundle *several);

/* Returns true when two are the same. */
bool bundle_text_equals(const bundle_text *a, const bundle_text *b);

void bundle_text_free(bundle_text *t);
void bundle_free(bundle *b);

#endif
