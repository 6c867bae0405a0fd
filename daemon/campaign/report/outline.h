/* SPDX-License-Identifier: MIT
 *
 * outline.h - a scenario of which items of lists are left out: rules, traffic, expectations.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_OUTLINE_H
#define CANWIRE_CAMPAIGN_REPORT_OUTLINE_H

#include <stdbool.h>
#include <stddef.h>
#include <yaml.h>

#define OUTLINE_LISTS_MAX 128u

typedef enum outline_kind {
    OUTLINE_FAULTS = 0, /* `faults` and `profiles` */
    OUTLINE_TRAFFIC,    /* `traffic` of a node */
    OUTLINE_EXPECT,
    OUTLINE_KINDS
} outline_kind;

typedef struct outline_list {
    outline_kind kind;
    const yaml_node_t *node; /* a sequence with items */
} outline_list;

typedef struct outline {
    bool loaded;
    yaml_document_t document;
    bool *left_out; /* by the number of a node, from 1 on */
    size_t nodes;
    outline_list lists[OUTLINE_LISTS_MAX];
    size_t list_count;
} outline;

/* Reads the text of a bus. Returns false when it is no document of one; free it in any case. */
bool outline_load(outline *o, const char *text, size_t size);

/* Returns the number of an item of a list, counted from 0, among the nodes; 0 at the end. */
size_t outline_item(const outline_list *list, size_t i);

/* Returns the items of a kind that are not left out. */
size_t outline_count(const outline *o, outline_kind kind);

/* Writes the text without the items that are left out, and without lists of which nothing is
 * left. without_faults: all of these are left out, too. folder: relative names of files get it
 * before them; NULL: they stay. The caller frees the text; NULL: aliases form a circle. */
char *outline_text(const outline *o, bool without_faults, const char *folder);

void outline_free(outline *o);

#endif
