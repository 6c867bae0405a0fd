/* SPDX-License-Identifier: MIT
 *
 * portname.h - the meaning of the name of a port: an interface, or a socket in place of one.
 */
#ifndef CANWIRE_CONFIG_PORTNAME_H
#define CANWIRE_CONFIG_PORTNAME_H

#include "config/node/address.h"

#define PORTNAME_INTERFACE_EXPECTED                                                                \
    "the name of an interface, at most 15 bytes without '/', ':', '%' and white space"
#define PORTNAME_EXPECTED                                                                          \
    PORTNAME_INTERFACE_EXPECTED ", or unix:PATH, or fd:NUMBER, or tcp:[HOST:]PORT, or "            \
                                "cannelloni:udp,peer=HOST:PORT, or { usb: INTERFACE }"

#define PORTNAME_PATH_MAX 107u /* sun_path with its final 0 has 108 bytes */

#define PORTNAME_TCP_DEFAULT 29536u /* the port of socketcand */
#define PORTNAME_BUS_MAX 32u
#define PORTNAME_TCP_MAX (ADDRESS_BYTES + PORTNAME_BUS_MAX + 8u) /* bytes of a whole text */

typedef enum portname_kind {
    PORTNAME_INVALID = 0,
    PORTNAME_INTERFACE, /* a vcan or vxcan interface */
    PORTNAME_UNIX,      /* unix:PATH, a socket that the ECU connects to */
    PORTNAME_FD,        /* fd:NUMBER, a connected socket that was inherited */
    PORTNAME_TCP,       /* tcp:[HOST:]PORT[/NAME], for programs that speak as to socketcand */
    PORTNAME_TUNNEL,    /* cannelloni:…, to another machine; see tunnelname.h */
    PORTNAME_USB,       /* usb:PATH, a socket that canwire-usb connects to */
} portname_kind;

typedef struct portname {
    portname_kind kind;
    const char *path; /* UNIX, USB: part of the text */
    int fd;           /* FD */
    net_address address; /* TCP */
    const char *bus;     /* TCP: what programs open; NULL: the name of the node */
} portname;

/* Reads the name of a port. The text must live as long as the result. */
portname portname_parse(const char *text);

/* Writes what is wrong with the name of a port that has a kind, and what is allowed. Returns false
 * for a name that is good, or has no kind. */
bool portname_explain(char why[ADDRESS_WHY_BYTES], const char *text);

/* Prints the name of a TCP port in full, so that equal ports have equal names. */
void portname_print_tcp(char out[PORTNAME_TCP_MAX], const portname *name, const char *node);

/* Returns true for the name of an interface, and false for NULL. */
bool portname_is_interface(const char *text);

/* Returns true for the name of a port that several programs can share, and false for NULL. */
bool portname_is_shared(const char *text);

#endif
