/* SPDX-License-Identifier: MIT
 *
 * tunnelname.h - the name of a port that is the end of a tunnel to another machine:
 * cannelloni:udp,listen=HOST:PORT,peer=HOST:PORT and the like.
 */
#ifndef CANWIRE_CONFIG_TUNNELNAME_H
#define CANWIRE_CONFIG_TUNNELNAME_H

#include "config/node/address.h"

#include <stdint.h>

#define TUNNELNAME_PREFIX "cannelloni:"
#define TUNNELNAME_BYTES (2 * ADDRESS_BYTES + 80u)
#define TUNNELNAME_PORT_DEFAULT 20000u /* of cannelloni */

typedef struct tunnelname {
    bool tcp;
    bool connects;      /* TCP: it connects to the peer, and does not listen */
    bool has_peer;      /* always, but for a TCP end that listens to anybody */
    net_address listen;
    net_address peer;
    uint64_t timeout_ns; /* for which frames wait for others */
    unsigned mtu;        /* bytes of a packet */
} tunnelname;

/* Reads the name of a tunnel. Returns false after writing what is wrong. */
bool tunnelname_read(tunnelname *out, const char *text, char why[ADDRESS_WHY_BYTES]);

/* The same without a reason. */
bool tunnelname_parse(tunnelname *out, const char *text);

/* Prints it in full, so that equal tunnels have equal names. */
void tunnelname_print(char out[TUNNELNAME_BYTES], const tunnelname *name);

#endif
