/* SPDX-License-Identifier: MIT
 *
 * portname.h - the meaning of the name of a port: an interface, or a socket in place of one.
 */
#ifndef CANWIRE_CONFIG_PORTNAME_H
#define CANWIRE_CONFIG_PORTNAME_H

#include <stdbool.h>

#define PORTNAME_INTERFACE_EXPECTED                                                                \
    "the name of an interface, at most 15 bytes without '/', ':' and white space"
#define PORTNAME_EXPECTED PORTNAME_INTERFACE_EXPECTED ", or unix:PATH, or fd:NUMBER"

#define PORTNAME_PATH_MAX 107u /* sun_path with its final 0 has 108 bytes */

typedef enum portname_kind {
    PORTNAME_INVALID = 0,
    PORTNAME_INTERFACE, /* a vcan or vxcan interface */
    PORTNAME_UNIX,      /* unix:PATH, a socket that the ECU connects to */
    PORTNAME_FD,        /* fd:NUMBER, a connected socket that was inherited */
} portname_kind;

typedef struct portname {
    portname_kind kind;
    const char *path; /* UNIX: part of the text */
    int fd;           /* FD */
} portname;

/* Reads the name of a port. The text must live as long as the result. */
portname portname_parse(const char *text);

/* Returns true for the name of an interface, and false for NULL. */
bool portname_is_interface(const char *text);

#endif
