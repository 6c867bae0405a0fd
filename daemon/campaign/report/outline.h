/* SPDX-License-Identifier: MIT
 *
 * outline.h - a scenario of which items of lists are left out: rules, traffic, expectations,
 * gateways. It is a bus or a rig.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_OUTLINE_H
#define CANWIRE_CAMPAIGN_REPORT_OUTLINE_H

#include <stdbool.h>
#include <stddef.h>
#include <yaml.h>

#define OUTLINE_LISTS_MAX 160u

typedef enum outline_kind {
    OUTLINE_FAULTS = 0, /* `faults` and `profiles` */
    OUTLINE_TRAFFIC,    /* `traffic` of a node */
    OUTLINE_EXPECT,
    OUTLINE_GATEWAYS, /* of a rig, and the rules of each */
    OUTLINE_BUSES,
    OUTLINE_KINDS
} outline_kind;

typedef struct outline_list {
    outline_kind kind;
    const yaml_node_t *node; /* a sequence with items */
    size_t owner; /* the item of another list that it is in, a gateway; 0: none */
} outline_list;

typedef struct outline {
    bool loaded;
    yaml_document_t document;
    bool is_rig;
    bool *left_out; /* by the number of a node, from 1 on */
    const char **renamed; /* ... what stands for it in another folder, not owned; NULL: itself */
    size_t nodes;
    outline_list lists[OUTLINE_LISTS_MAX];
    size_t list_count;
} outline;

/* Reads the text of a bus or of a rig. Returns false when it is not one; free it in any case. */
bool outline_load(outline *o, const char *text, size_t size);

/* Returns the number of an item of a list, counted from 0, among the nodes; 0 at the end. */
size_t outline_item(const outline_list *list, size_t i);

/* Returns the list of the buses of a rig, or NULL. */
const outline_list *outline_buses(const outline *o);

/* Returns true when a list is in an item that is left out. */
bool outline_is_gone(const outline *o, const outline_list *list);

/* Returns the items of a kind that are not left out. */
size_t outline_count(const outline *o, outline_kind kind);

/* Writes the text without the items that are left out, and without lists of which nothing is
 * left. without_faults: all of these are left out, too. folder: the text is for another folder.
 * Relative names of files get this one before them, and texts are renamed. NULL: they stay.
 * The caller frees the text; NULL: aliases form a circle. */
char *outline_text(const outline *o, bool without_faults, const char *folder);

void outline_free(outline *o);

#endif
