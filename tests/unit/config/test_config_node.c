/* SPDX-License-Identifier: MIT
 *
 * test_config_node.c - the nodes of a configuration: their keys, defaults and ports, and which of
 * them a later configuration means.
 */
#include "cases.h"
#include "configs.h"

#include "config/change/live.h"
#include "config/parts.h"

#define UDP "cannelloni:udp,listen="
#define TCP "cannelloni:tcp,"
#define REST(timeout) ",timeout=" timeout ",mtu=1472"

TEST(ports_are_read)
{
    static const char *const ports[] = {"vcan0", "unix:/run/rig/absolute.sock",
                                        "unix:" GOOD "run/a relative.sock", "fd:3", "fd:10",
                                        "tcp:127.0.0.1:29536/tcp",
                                        "tcp:127.0.0.1:29537/tcp-port",
                                        "tcp:127.0.0.1:29537/tcp-same",
                                        "tcp:127.0.0.1:29537/can0", "tcp:192.168.1.2:29536/can0",
                                        "tcp:0.0.0.0:1/tcp-any", "tcp:[::1]:65535/tcp-six",
                                        "tcp:[fe80::1]:29536/tcp-six-too",
                                        UDP "0.0.0.0:20000,peer=192.168.1.2:20001" REST("1000us"),
                                        UDP "0.0.0.0:20001,peer=10.0.0.1:20000,timeout=2500us,"
                                            "mtu=80",
                                        UDP "127.0.0.1:2,peer=127.0.0.1:1" REST("1000us"),
                                        UDP "10.0.0.2:20002,peer=10.0.0.1:20000" REST("0us"),
                                        UDP "[::]:20000,peer=[fd00::1]:20000,timeout=1000us,"
                                            "mtu=65507",
                                        TCP "listen=0.0.0.0:20003" REST("1000000us"),
                                        TCP "listen=0.0.0.0:20000,peer=10.0.0.1:20000"
                                            REST("1000us"),
                                        TCP "connect=10.0.0.1:20004" REST("1000us")};
    CFG *config = load_good(GOOD "ports.yaml");
    assert_int_equal(config->node_count, sizeof ports / sizeof ports[0]);
    for (unsigned i = 0; i < config->node_count; i++)
        assert_string_equal(config->nodes[i].port, ports[i]);
    assert_int_equal(config->nodes[6].clients.max, 4);
    assert_true(config->nodes[6].clients.beacon);
    assert_false(config->nodes[7].clients.beacon);
    assert_int_equal(config->pacing, CFG_PACING_SPIN);
    for (unsigned i = 0; i < 5; i++) { /* the first is an interface, the others are sockets */
        assert_int_equal(config->nodes[i].queue, 1024);
        assert_int_equal(config->nodes[i].when_full,
                         i == 0 ? CFG_WHEN_FULL_DROP : CFG_WHEN_FULL_WAIT);
    }
}

TEST(ports_have_peers_by_one_key)
{
    static const char *const peers[] = {"engine", "can0", "can0", NULL, NULL};
    CFG *config = load_good(GOOD "vxcan.yaml");
    assert_true(config->vxcan);
    for (unsigned i = 0; i < 5; i++) {
        if (peers[i])
            assert_string_equal(config->nodes[i].peer, peers[i]);
        else
            assert_null(config->nodes[i].peer);
    }
    assert_null(config->nodes[1].netns);
    assert_string_equal(config->nodes[2].netns, "dash");
}

TEST(node_keys_are_read)
{
    CFG *config = load_good(GOOD "full.yaml");
    const cfg_node *engine = &config->nodes[0];
    const cfg_node *gearbox = &config->nodes[1];

    assert_int_equal(config->node_count, 3);
    assert_string_equal(engine->name, "engine");
    assert_string_equal(engine->port, "vcan0");
    assert_null(engine->peer);
    assert_int_equal(engine->restart_ms, 100);
    assert_true(engine->berr_reporting);
    assert_int_equal(engine->modes, CW_MODE_ONE_SHOT | CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK |
                                        CW_MODE_PRESUME_ACK | CW_MODE_BERR_REPORTING |
                                        CW_MODE_LOST_ARBITRATION_REPORTING);
    assert_int_equal(engine->queue, 4096);
    assert_int_equal(engine->when_full, CFG_WHEN_FULL_WAIT);
    assert_int_equal(gearbox->when_full, CFG_WHEN_FULL_DROP);
    assert_int_equal(gearbox->queue, 1024);
    assert_int_equal(engine->order, CW_ORDER_FIFO);
    assert_int_equal(engine->warning_limit, 255);
    assert_string_equal(gearbox->port, "vxcan1");
    assert_string_equal(gearbox->peer, "can0");
    assert_string_equal(gearbox->netns, "gearbox");
    assert_int_equal(gearbox->modes, 0);
    assert_false(gearbox->berr_reporting);
    assert_int_equal(gearbox->warning_limit, 1);
}

TEST(nodes_have_defaults_and_may_say_otherwise)
{
    static const unsigned modes = CW_MODE_ONE_SHOT | CW_MODE_PRESUME_ACK |
                                  CW_MODE_BERR_REPORTING | CW_MODE_LOST_ARBITRATION_REPORTING;
    CFG *config = load_good(GOOD "defaults.yaml");
    const cfg_node *all = &config->nodes[0];
    const cfg_node *own = &config->nodes[1];
    const cfg_node *interface = &config->nodes[2];
    const cfg_node *socket = &config->nodes[3];

    assert_int_equal(all->restart_ms, 100);
    assert_int_equal(all->modes, modes);
    assert_true(all->berr_reporting);
    assert_int_equal(all->queue, 64);
    assert_int_equal(all->when_full, CFG_WHEN_FULL_DROP); /* it has no port */
    assert_int_equal(all->order, CW_ORDER_FIFO);
    assert_int_equal(all->warning_limit, 90);
    assert_int_equal(own->restart_ms, 0);
    assert_int_equal(own->modes, modes & ~(unsigned)CW_MODE_ONE_SHOT);
    assert_int_equal(own->queue, 3);
    assert_int_equal(own->order, CW_ORDER_PRIORITY);
    assert_int_equal(own->warning_limit, 96);
    assert_int_equal(interface->queue, 64); /* not what an interface has by itself */
    assert_int_equal(interface->when_full, CFG_WHEN_FULL_WAIT);
    assert_int_equal(socket->when_full, CFG_WHEN_FULL_DROP);
    assert_false(socket->berr_reporting);
    assert_int_equal(config->nodes[4].queue, 7);
}

/* Whoever writes the default of a key has what the key has by itself. */
TEST(defaults_of_nodes_are_those_of_the_table)
{
    CFG *config = load_good(GOOD "faults.yaml");
    schema self = {.has_open = false};
    cfg_node node = config->nodes[0];
    unsigned count = 0;

    for (const schema_key *key = cfg_node_keys; key->name; key++) {
        if (!key->preset || cfg_is_retime(key) || key->read == cfg_read_controller)
            continue;
        schema_read_preset(&self, key, &node);
        if (memcmp(&node, &config->nodes[0], sizeof node) != 0)
            fail_msg("%s is not %s", key->name, key->preset);
        count++;
    }
    assert_true(count > 10);
}

TEST(nodes_are_matched_by_name)
{
    CFG *full = load_good(GOOD "full.yaml");
    CFG *small = load_good(GOOD "expect.yaml");
    uint8_t from[CW_NODES_MAX];

    cfg_match_nodes(from, small, full); /* engine, gearbox, dash of engine, gearbox, load */
    assert_int_equal(from[0], 0);
    assert_int_equal(from[1], 1);
    for (size_t i = 2; i < CW_NODES_MAX; i++)
        assert_int_equal(from[i], CW_NO_NODE);
}
