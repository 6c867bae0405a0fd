/* SPDX-License-Identifier: MIT
 *
 * profilefile.h - where a fault profile is looked for: it may be named, or be given as a path.
 */
#ifndef CANWIRE_CONFIG_PROFILEFILE_H
#define CANWIRE_CONFIG_PROFILEFILE_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>

#define PROFILEFILE_BESIDE 2
#define PROFILEFILE_LIST_BYTES (2 * PATH_MAX) /* of folders in a message */

/* A profile that is wanted. */
typedef struct profilefile {
    const char *name;                       /* with or without .yaml, or a path */
    const char *beside[PROFILEFILE_BESIDE]; /* files in whose folders it may be, or NULL; a file in
                                               the current folder has no '/' */
} profilefile;

/* Writes the path with this number, from 0, at which the profile may be. The search goes from its
 * path next to the files to its name in `profiles` there, and then to the installed ones. Returns
 * false when there are no more. A path that is too long is "". */
bool profilefile_place(char out[PATH_MAX], const profilefile *wanted, unsigned number);

/* Returns true when there is a regular file at a path, or anything at all. */
bool profilefile_is_there(const char *path, bool any);

/* Finds the first of these places where there is a regular file. Returns false without one. */
bool profilefile_find(char out[PATH_MAX], const profilefile *wanted);

/* Writes the folders of all these places, "a, b and c", and " (did you mean 'wobble'?)" when a
 * profile there has nearly the name. Only for a name. */
void profilefile_list(char out[PROFILEFILE_LIST_BYTES], const profilefile *wanted);

/* Returns true for a name that is searched for, not only looked up next to the files. */
bool profilefile_is_name(const char *name);

#endif
