/* SPDX-License-Identifier: MIT
 *
 * tunnelname.c - the name of a port that is the end of a tunnel to another machine.
 */
#include "config/tunnelname.h"

#include "base/number.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define MTU_DEFAULT 1472u /* of Ethernet, without the heads of IPv4 and UDP */
#define MTU_MIN 80u       /* for the longest frame, 5 + 70 bytes */
#define MTU_MAX 65507u    /* of UDP */
#define TIMEOUT_DEFAULT_NS UINT64_C(1000000)
#define TIMEOUT_MAX_NS UINT64_C(1000000000)
#define NS_PER_US 1000u
#define VALUE_BYTES (ADDRESS_BYTES + 1u)

/* A key with its value, and the part of the text behind them. */
typedef struct pair {
    char key[16];
    char value[VALUE_BYTES];
} pair;

/* Takes KEY=VALUE up to the next comma. Returns the text behind it, NULL for something else. */
static const char *take_pair(pair *out, const char *text)
{
    const size_t length = strcspn(text, ",");
    const size_t key = strcspn(text, "=,");
    if (key == length || key >= sizeof out->key || length - key > sizeof out->value)
        return NULL;
    (void)snprintf(out->key, sizeof out->key, "%.*s", (int)key, text);
    (void)snprintf(out->value, sizeof out->value, "%.*s", (int)(length - key - 1), text + key + 1);
    return text + length;
}

static bool take_address(net_address *out, bool *has, const char *value)
{
    const bool first = !*has;
    *has = true;
    return first && *value && address_parse(out, value, strlen(value), TUNNELNAME_PORT_DEFAULT);
}

static bool take_timeout(tunnelname *name, const char *value)
{
    cfg_time time;
    if (text_parse_time(&time, value) || time.bits > 0 || time.ns > TIMEOUT_MAX_NS ||
        time.ns % NS_PER_US != 0)
        return false;
    name->timeout_ns = time.ns;
    return true;
}

static bool take_mtu(tunnelname *name, const char *value)
{
    uint64_t mtu;
    if (text_parse_uint(&mtu, value) || mtu < MTU_MIN || mtu > MTU_MAX)
        return false;
    name->mtu = (unsigned)mtu;
    return true;
}

static bool take(tunnelname *name, bool *listens, bool *host, const pair *p)
{
    if (strcmp(p->key, "listen") == 0) {
        *host = p->value[strspn(p->value, "0123456789")] != '\0';
        return take_address(&name->listen, listens, p->value);
    }
    if (strcmp(p->key, "peer") == 0)
        return take_address(&name->peer, &name->has_peer, p->value);
    if (strcmp(p->key, "connect") == 0) {
        name->connects = true;
        return take_address(&name->peer, &name->has_peer, p->value);
    }
    if (strcmp(p->key, "timeout") == 0)
        return take_timeout(name, p->value);
    return strcmp(p->key, "mtu") == 0 && take_mtu(name, p->value);
}

/* The own end of a UDP tunnel to another machine has any address of this one. Only packets of the
 * peer are taken. */
static void complete_host(tunnelname *name)
{
    const bool six = strchr(name->peer.host, ':') != NULL;
    const char *peer = name->peer.host;
    if (strncmp(peer, "127.", 4) == 0 || strcmp(peer, "::1") == 0)
        strcpy(name->listen.host, six ? "::1" : "127.0.0.1");
    else
        strcpy(name->listen.host, six ? "::" : "0.0.0.0");
}

/* Returns true when the ends of a tunnel fit: UDP needs a peer, and of TCP one end connects. */
static bool fits(const tunnelname *name, bool listens)
{
    const bool six = strchr(name->listen.host, ':') != NULL;
    if (name->has_peer && !name->connects && six != (strchr(name->peer.host, ':') != NULL))
        return false;
    return name->tcp ? name->connects != listens : name->has_peer && !name->connects;
}

bool tunnelname_parse(tunnelname *out, const char *text)
{
    bool listens = false, host = false;
    pair p;
    *out = (tunnelname){.timeout_ns = TIMEOUT_DEFAULT_NS, .mtu = MTU_DEFAULT};
    if (strncmp(text, TUNNELNAME_PREFIX "udp", strlen(TUNNELNAME_PREFIX "udp")) != 0 &&
        strncmp(text, TUNNELNAME_PREFIX "tcp", strlen(TUNNELNAME_PREFIX "tcp")) != 0)
        return false;
    text += strlen(TUNNELNAME_PREFIX);
    out->tcp = text[0] == 't';
    (void)address_parse(&out->listen, "", 0, TUNNELNAME_PORT_DEFAULT);
    for (text += strlen("udp"); *text == ',';) {
        text = take_pair(&p, text + 1);
        if (!text || !take(out, &listens, &host, &p))
            return false;
    }
    if (!out->tcp && !host && out->has_peer)
        complete_host(out);
    return *text == '\0' && fits(out, listens);
}

void tunnelname_print(char out[TUNNELNAME_BYTES], const tunnelname *name)
{
    char listen[ADDRESS_BYTES], peer[ADDRESS_BYTES];
    address_print(listen, &name->listen);
    address_print(peer, &name->peer);
    const bool listens = !name->connects;
    (void)snprintf(out, TUNNELNAME_BYTES,
                   TUNNELNAME_PREFIX "%s%s%s%s%s,timeout=%" PRIu64 "us,mtu=%u",
                   name->tcp ? "tcp" : "udp", listens ? ",listen=" : "", listens ? listen : "",
                   !name->has_peer ? "" : name->connects ? ",connect=" : ",peer=",
                   name->has_peer ? peer : "", name->timeout_ns / NS_PER_US, name->mtu);
}
