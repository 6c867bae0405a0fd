# SPDX-License-Identifier: MIT
#
# canwire - the wire between virtual ECUs. `make help` lists the targets.

# The one place of the version: programs, library, man pages and packages take it from here.
VERSION := 0.2.0
VARIANT ?= release
CC ?= cc
HOSTCC ?= cc

# ARCH=arm64 builds for that architecture with Debian's cross compiler, against the libraries that
# scripts/cross-root unpacks. Programs of it that the build or the tests call are emulated. An ARCH
# in the environment, which kernel developers export, does not count.
HOST_ARCH = $(shell dpkg --print-architecture)
ifeq ($(origin ARCH),command line)
ifneq ($(ARCH),$(HOST_ARCH))
ifneq ($(ARCH),arm64)
$(error ARCH is arm64, or the architecture of this machine)
endif
CROSS := aarch64-linux-gnu-
CROSS_ROOT ?= $(CURDIR)/build/cross/$(ARCH)
CC := $(CROSS)gcc --sysroot=$(CROSS_ROOT)/root
AR := $(CROSS)ar
RUN := qemu-aarch64-static -L $(CROSS_ROOT)/root
BUILD ?= build/$(ARCH)
CROSS_GROUP := $(ARCH)
PREPARE_CROSS = @scripts/cross-root $(ARCH) $(CROSS_ROOT)
endif
endif
BUILD ?= build/$(VARIANT)
PREFIX ?= /usr/local
GEN := build/gen

WARNINGS := -Wall -Wextra -Werror -Wconversion -Wsign-conversion -Wshadow -Wswitch-enum \
  -Wstrict-prototypes -Wmissing-prototypes -Wvla
OPTIMISE_release := -O2 -g
# The engine asserts its invariants at every step where speed does not count.
CHECKED := -DCW_CHECKED=1
OPTIMISE_debug := -O0 -g3 $(CHECKED)
OPTIMISE_mutant := -O0
OPTIMISE_san := -O1 -g $(CHECKED) -fsanitize=address,undefined -fno-sanitize-recover=undefined \
  -fno-omit-frame-pointer
OPTIMISE_cover := -O0 -g --coverage
# The world tests count work in basic blocks (tests/world). These flags keep the blocks of the
# source, without most of the inlining.
OPTIMISE_world := -O1 -g -fno-omit-frame-pointer -U_FORTIFY_SOURCE -Wno-format-truncation
OPTIMISE_worldsan := $(OPTIMISE_world) -fsanitize=address,undefined \
  -fno-sanitize-recover=undefined
# ... and counts what a training does, for PGO=1.
OPTIMISE_train := $(OPTIMISE_release)
OPTIMISE_fuzz := -O1 -g $(CHECKED) -fsanitize=fuzzer-no-link,address,undefined \
  -fno-sanitize-recover=undefined -fno-omit-frame-pointer
ifeq ($(OPTIMISE_$(VARIANT)),)
$(error VARIANT is debug, release or san)
endif

# Debian's options for programs that read files and clients of strangers. They need an optimizer
# (_FORTIFY_SOURCE), and a sanitizer does all of this better.
ifeq ($(VARIANT),release)
HARDEN := -D_FORTIFY_SOURCE=2 -fstack-protector-strong -fstack-clash-protection -fPIE \
  -Wformat -Werror=format-security
HARDEN += $(if $(filter x86_64% i%86%,$(shell $(CC) -dumpmachine)),-fcf-protection)
HARDEN_LINK := -pie -Wl,-z,relro -Wl,-z,now
endif
# The engine is exempt from options that cost instructions in each function (2 to 3 % of a frame).
# It reads no files and no sockets, its arrays are of fixed size, and it calls only mem*. Its
# training must be the same program.
ifneq ($(filter release train,$(VARIANT)),)
LIB_EXEMPT := -fno-stack-protector -fno-stack-clash-protection -U_FORTIFY_SOURCE
endif

DAEMON_LIBS := -lev -llcm -lsystemd -lm
SIM_LIBS := -lyaml -ljansson -lm
TOOL_LIBS := $(SIM_LIBS) -lzstd
SCREEN_LIBS := -lncurses -ltinfo # of the tool alone

CFLAGS ?=
ALL_CFLAGS = -std=c17 -D_GNU_SOURCE $(OPTIMISE_$(VARIANT)) $(HARDEN) $(WARNINGS) -Ilib \
  -I$(GEN)/lib -MMD -MP $(CFLAGS)
DAEMON_CFLAGS = $(ALL_CFLAGS) -Idaemon -I$(GEN)/daemon -isystem $(GEN)

LIB_SOURCES := $(wildcard lib/*.c lib/*/*.c)
# all of daemon/ but the main functions; an archive, so that each program takes what it needs
PARTS_SOURCES := $(filter-out daemon/cli/main.c daemon/usb/main.c daemon/preload/% daemon/embed/% \
  daemon/schema/%, \
  $(wildcard daemon/*/*.c daemon/*/*/*.c))
PRELOAD_SOURCES := $(wildcard daemon/preload/*.c daemon/preload/*/*.c)
SIM_FOLDERS := base timing trace config run record sim embed
SIM_SOURCES := $(LIB_SOURCES) \
  $(filter-out daemon/base/jsonexit.c daemon/base/unit.c daemon/run/journal%, \
  $(foreach folder,$(SIM_FOLDERS),$(wildcard daemon/$(folder)/*.c daemon/$(folder)/*/*.c)))
DAEMON_SOURCES := daemon/main.c \
  $(filter-out daemon/campaign/% daemon/cli/% daemon/usb/%,$(PARTS_SOURCES))
LCM_TYPES := $(wildcard config/lcm/*.lcm)
LCM_SOURCES := $(patsubst config/lcm/%.lcm,$(GEN)/canwire_%.c,$(LCM_TYPES))
FUZZ_TARGETS := $(patsubst tests/fuzz/%.c,%,$(wildcard tests/fuzz/fuzz_*.c))
CORPORA = $(FUZZ_TARGETS:fuzz_%=$(BUILD)/corpus/%)
UNIT_SOURCES := $(wildcard tests/unit/test_*.c tests/unit/*/test_*.c)
UNIT_TESTS := $(patsubst %.c,%,$(notdir $(UNIT_SOURCES)))

objects = $(patsubst %.c,$(BUILD)/%.o,$(1))

# Each step prints a short line; V=1 shows the commands, make -s nothing.
tell = $(if $(filter 1,$(V)),,@$(if $(findstring s,$(filter-out --%,$(firstword -$(MAKEFLAGS)))),,\
  printf '%-4s %s\n' $(1) $(2);))
link = $(call tell,LD,$@) $(CC) $(ALL_CFLAGS) $(1) $(HARDEN_LINK) $(LDFLAGS) -o $@ $^
LIB := $(BUILD)/libcanwire.a
LIB_OBJECTS = $(call objects,$(LIB_SOURCES)) $(BUILD)/lib/format/tables.o
LAYOUT := $(GEN)/lib/format/layout.h
VERSION_HEADER := $(GEN)/daemon/base/version.h
DAEMON := $(BUILD)/canwired
TOOL := $(BUILD)/canwire
PRELOAD := $(BUILD)/libcanwire-socketcan.so
SIM := $(BUILD)/libcanwire-sim.so
USB := $(BUILD)/canwire-usb
CONFORMANCE := $(BUILD)/conformance
SCHEMA := $(BUILD)/schema/canwire.schema.json
MAN_PAGES := $(patsubst daemon/man/%.md,$(BUILD)/man/%,$(wildcard daemon/man/*.md))
DIFFERENTIAL := $(BUILD)/differential
MUTANTS := $(BUILD)/mutants
PARTS := $(BUILD)/libparts.a
LCM_OBJECTS := $(patsubst $(GEN)/%.c,$(BUILD)/gen/%.o,$(LCM_SOURCES))

# All code for `make dev`. Programs that use it are as they were when it has changed.
ifeq ($(SHARED),yes)
SHARED_CODE := $(BUILD)/libdev.so
DAEMON_CODE := | $(SHARED_CODE)
TOOL_CODE := | $(SHARED_CODE)
WITH_SHARED := $(SHARED_CODE) -Wl,-rpath,$(CURDIR)/$(BUILD)
ALL_CFLAGS += -fPIC
else
DAEMON_CODE := $(PARTS) $(LCM_OBJECTS) $(LIB)
TOOL_CODE := $(PARTS) $(LIB)
endif

.PHONY: all always dev dev-run picture calls soak mutant mutant-run mutant-short-cuts \
  mutant-short-cuts-run mutant-campaign mutant-campaign-run test test-deep test-arm64 test-unit \
  dist demo bench gates check cover man install uninstall deb wheel clean help build fuzz fuzz-run \
  fuzz-merge fuzz-merge-run world world-night world-proof test-newer-kernel
.DELETE_ON_ERROR:

all: ## install what the build needs, then build canwired and canwire
	@scripts/install-deps build $(CROSS_GROUP)
	$(PREPARE_CROSS)
	@$(MAKE) --no-print-directory LTO=yes build

# Tests load the library for programs in one variant only.
build: $(if $(filter release,$(VARIANT)),$(SIM))
build: $(DAEMON) $(TOOL) $(USB) $(PRELOAD) $(SCHEMA) ## the programs alone, with what is installed

# The compiler runs only when ccache has no result; the first call installs missing packages. All
# code is in one library, so that a change needs one link.
dev: ## for the loop of a developer: build/dev, and the quick unit tests; 5 s after a change
	@test -d build/dev || scripts/install-deps build test
	@$(MAKE) --no-print-directory -j"$$(nproc)" VARIANT=debug BUILD=build/dev SHARED=yes \
	  CC="$$(command -v ccache || true) $(CC)" dev-run

test: ## all set-up, then all tests (units, sanitizers, conformance, real vcan); ten minutes
	@scripts/install-deps all
	@scripts/test

test-deep: ## the same with all that `make test` takes samples of, for nightly runs and releases
	@scripts/install-deps all arm64
	@scripts/test deep

demo: ## three ECUs on real vcan, with canwired between them; under a minute
	@scripts/install-deps build demo
	@$(MAKE) --no-print-directory build
	@scripts/demo

# The build is that of the package, whatever CFLAGS say.
GATES := --no-print-directory LTO=yes PGO=1 VARIANT=release CFLAGS= BUILD=build/gates
bench: ## measure the cost of canwire, in ns and instructions, beside others; build/bench.json
	@scripts/install-deps build bench
	@scripts/venv
	@$(MAKE) $(GATES) build/gates/bench build/gates/bench_realtime build/gates/canwire
	@scripts/bench --build build/gates

gates: ## no kind of work takes 1 % more instructions than ever; WRITE=yes keeps what is better
	@scripts/install-deps build bench
	@$(MAKE) $(GATES) build/gates/bench build/gates/bench_sim build/gates/canwire
	@scripts/gates $(if $(WRITE),--write)

# SCOPE=changed: clang-tidy and the analyzer look at files that changed, and at some others.
SCOPE ?= all
check: ## static analysis: compiler, clang-tidy, cppcheck, shellcheck; needs of the library
	@scripts/install-deps all
	@$(MAKE) --no-print-directory LIB_FLAGS= BUILD=build/check build/check/libcanwire.a \
	  $(LCM_SOURCES) $(VERSION_HEADER)
	@scripts/check build/check/libcanwire.a $(SCOPE)

picture: build ## draw the picture in README.md again
	$(TOOL) sim config/picture/one-bad-bit.yaml --svg config/picture/one-bad-bit.svg \
	  --from 120us --to 200us

FUZZ ?= 60
fuzz: ## look for inputs that break parsers, ports, controller or bus, for FUZZ=60 seconds in all
	@scripts/install-deps build test
	@$(MAKE) --no-print-directory VARIANT=fuzz CC=clang BUILD=build/fuzz fuzz-run

fuzz-merge: ## add new findings of `make fuzz` to tests/fuzz/corpus
	@scripts/install-deps build test
	@$(MAKE) --no-print-directory VARIANT=fuzz CC=clang BUILD=build/fuzz fuzz-merge-run

# A run prints its SEED, which repeats the same actions; each run takes another one.
SOAK ?= 10m
SEED ?= $(shell date +%s)
soak: ## 10^9 bits of random scenarios, SOAK=10m of random trouble for canwired under ASan/UBSan
	@scripts/install-deps build test
	@scripts/venv
	@$(MAKE) --no-print-directory $(DIFFERENTIAL)
	@$(MAKE) --no-print-directory VARIANT=san BUILD=build/san build
	@scripts/soak '$(SOAK)' '$(SEED)' $(DIFFERENTIAL) build/san/canwired

calls: ## every call of the C library fails, at all places, with every error; half an hour
	@scripts/install-deps build test
	@scripts/venv
	@$(MAKE) --no-print-directory build
	@CALLS=all build/venv/bin/python -m pytest -q -s -p no:cacheprovider tests/calls/test_calls.py \
	  tests/calls/test_calls_daemon.py

# Seeds of the simulated world: FIRST..LAST, or one; `world 7 --trace` shows each call. The nightly
# run is SEEDS=1..10000, and `make test` runs 60 of them.
SEEDS ?= 1..200
WORLD_VARIANT ?= world
WORLD_BUILD = VARIANT=$(WORLD_VARIANT) BUILD=build/$(WORLD_VARIANT)
world: ## canwired in simulated worlds (clocks, disk, sockets, signals), SEEDS=1..200
	@scripts/install-deps build test
	@$(MAKE) --no-print-directory -s -j2 $(WORLD_BUILD) build/$(WORLD_VARIANT)/world
	@scripts/world build/$(WORLD_VARIANT)/world '$(SEEDS)'

world-night: ## the same under ASan and UBSan, 10000 seeds; lists those that fail
	@$(MAKE) --no-print-directory world SEEDS=1..10000 WORLD_VARIANT=worldsan

world-proof: ## the simulated world finds each repaired bug when the repair is removed
	@scripts/install-deps build test
	@scripts/world-proof

# KERNEL: a directory, where the package of a kernel may be unpacked already.
KERNEL ?= build/kernel
test-newer-kernel: ## the tests of a real can0 on a newer kernel of Debian, which is downloaded
	@scripts/install-deps build test
	@scripts/venv
	@$(MAKE) --no-print-directory build
	@scripts/newer-kernel '$(KERNEL)'
	@scripts/guest -t 1200 --kernel '$(KERNEL)' -- build/venv/bin/python -m pytest -q -rs \
	  -p no:cacheprovider tests/kernel/test_usb.py

cover: ## line coverage of lib and daemon by the tests, and build/cover/missed.txt; ten minutes
	@scripts/install-deps build test
	@scripts/venv
	@$(MAKE) --no-print-directory VARIANT=cover CC=gcc BUILD=build/cover build
	@scripts/cover

man: $(MAN_PAGES) ## the man pages, from daemon/man, --help and JSON schema

INSTALL_FILES = DESTDIR='$(DESTDIR)' PREFIX='$(PREFIX)' SYSCONFDIR='$(SYSCONFDIR)' \
  UNITDIR='$(UNITDIR)' EXTCAPDIR='$(EXTCAPDIR)' BUILD='$(BUILD)' scripts/install-files

install: build man ## into $(DESTDIR)$(PREFIX), with units, configuration in $(DESTDIR)$(SYSCONFDIR)
	@$(INSTALL_FILES) install

uninstall: ## remove exactly the files that install has put there
	@$(INSTALL_FILES) uninstall

deb: ## a Debian package in build/deb; ARCH=arm64 makes one for that architecture
	@scripts/install-deps build deb $(CROSS_GROUP)
	$(PREPARE_CROSS)
	@CROSS_ROOT='$(CROSS_ROOT)' scripts/deb $(VERSION) $(CROSS_GROUP)

wheel: ## the Python package as a wheel and as sources, in build; with ARCH=arm64 for that one
	@scripts/install-deps build $(CROSS_GROUP)
	$(PREPARE_CROSS)
	@$(MAKE) --no-print-directory LTO=yes $(if $(IS_GCC),PGO=1) $(WHEEL_SIM)
	@CC='$(CC)' scripts/wheel $(WHEEL_SIM) build

# TWICE=yes builds all again elsewhere, and compares.
dist: ## the files of a release, in build/dist: sources, packages and wheels for amd64 and arm64
	@scripts/install-deps build deb arm64
	@CROSS_ROOT='$(CURDIR)/build/cross/arm64' scripts/dist $(if $(TWICE),--twice) $(VERSION) \
	  $(sort $(HOST_ARCH) arm64)

test-arm64: ## units, conformance, scenarios, canwired and `canwire run` for ARM64, emulated
	@scripts/install-deps build test arm64
	@scripts/venv
	@scripts/test-arm64

clean: ## remove all built files, the guest's image included
	rm -rf build

help: ## this list
	@echo "canwire $(VERSION). Targets:"
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  \1\t\2/p' $(MAKEFILE_LIST) | expand -t 14
	@echo "Variables: V=1 (show commands), VARIANT=release|debug|san, CC=gcc|clang, ARCH=arm64," \
	  "PGO=1 (a faster engine, by a training), PREFIX, DESTDIR, SYSCONFDIR, UNITDIR, EXTCAPDIR"

# scripts/test runs these targets: unit tests of one variant and compiler. The differential test
# takes fewer bits where each costs more; `make test` takes one in FEWER of them.
FEWER ?= 1
DIFFERENTIAL_BITS_release := 5000000
DIFFERENTIAL_BITS_debug := 1000000
DIFFERENTIAL_BITS = $(shell expr $(or $(DIFFERENTIAL_BITS_$(VARIANT)),2000000) / $(FEWER))

# In a sample, tests that compare many results run in one variant of this machine only, and so do
# most of the conformance cases.
FIGURES := test_away test_clocks test_encode_fd test_format test_quanta test_steady
ifneq ($(VARIANT)$(CROSS),release)
ifneq ($(FEWER),1)
LEFT_OUT := $(FIGURES)
CASES := 7.2 7.5 7.7 8.1 8.4 8.6 9 X
endif
endif
# QEMU's emulator lacks SO_TIMESTAMPNS, by which ports `unix:` know when a frame was sent.
ifdef CROSS
LEFT_OUT += test_engine_flood test_port_clients test_port_gather test_port_unix fuzz_port
endif
TESTS_RUN := $(filter-out $(LEFT_OUT),$(UNIT_TESTS))
REPLAYED := $(filter-out $(LEFT_OUT),$(FUZZ_TARGETS))

# Of the configurations with something missing, one in so many. MUTANTS_EVERY=1 on the command line
# takes all.
MUTANTS_EVERY_release := 2
MUTANTS_EVERY_debug := 28
MUTANTS_EVERY = $(shell expr $(or $(MUTANTS_EVERY_$(VARIANT)),14) '*' $(FEWER))

test-unit: $(addprefix $(BUILD)/,$(TESTS_RUN) $(REPLAYED:%=replay_%)) $(CONFORMANCE) $(TOOL) \
  $(CORPORA) $(DIFFERENTIAL) $(MUTANTS) $(BUILD)/bench $(BUILD)/bench_realtime $(RUNNERS)
	@status=0; run() { \
	    name="$$1 ($(VARIANT), $(filter-out --sysroot=%,$(CC)))"; shift; echo "== $$name"; \
	    "$$@" || { echo "FAILED $$name: exit status $$?"; status=1; }; \
	  }; \
	  for test in $(TESTS_RUN); do run "$$test" env CANWIRE=$(STARTED)/canwire \
	    $(RUN) $(BUILD)/$$test; done; \
	  run conformance $(RUN) $(CONFORMANCE) $(CASES); \
	  $(foreach target,$(REPLAYED),\
	    run replay_$(target) $(RUN) $(BUILD)/replay_$(target) \
	      $(call fuzz_seeds,$(target));) \
	  run differential $(RUN) $(DIFFERENTIAL) --bits $(DIFFERENTIAL_BITS); \
	  run "differential, clocks of nodes" \
	    $(RUN) $(DIFFERENTIAL) --own-clocks --bits $(DIFFERENTIAL_BITS); \
	  run mutants $(RUN) $(MUTANTS) --every $(MUTANTS_EVERY); \
	  run "bench, the work without times" $(RUN) $(BUILD)/bench --check; \
	  $(if $(CROSS),,run "bench in real time, the work without times" \
	    $(BUILD)/bench_realtime --check;) \
	  exit $$status

# The unit tests without those that take half a second or more.
DEV_SLOW := test_apart test_away test_clocks test_encode_fd test_engine_replay test_fault_noise \
            test_fault_step test_format test_hours test_journal test_journal_check \
            test_journal_keep test_journal_pack test_journal_play test_journal_traffic test_order \
            test_quanta test_rates test_recorder test_run_end test_steady test_takeover \
            test_timed_hosts
DEV_TESTS := $(filter-out $(DEV_SLOW),$(UNIT_TESTS))
dev-run: $(DAEMON) $(TOOL) $(PRELOAD) $(DEV_TESTS:%=$(BUILD)/%.passed)

$(BUILD)/%.passed: $(BUILD)/% $(TOOL) $(SHARED_CODE)
	$(call tell,TEST,$(<F)) CANWIRE=$(TOOL) $< >$@.log 2>&1 || { cat $@.log; false; }
	@touch $@

# The initial inputs: those of the target, with earlier findings, and files for users.
FUZZ_SEEDS_fuzz_config := tests/config tests/scenarios config
FUZZ_SEEDS_fuzz_trace := tests/traces
FUZZ_SEEDS_fuzz_rules := config/profiles tests/config
fuzz_seeds = $(BUILD)/corpus/$(1:fuzz_%=%) $(FUZZ_SEEDS_$(1))

$(BUILD)/corpus/%: tests/fuzz/corpus/%.tar.gz
	@rm -rf $@ && mkdir -p $@ && tar -xf $< -C $@ && touch $@

# Limits of an input in bytes; without one the longest initial input decides. The initial inputs of
# fuzz_config include other files, whose length would make it slow.
FUZZ_BYTES_fuzz_bus := 1000
FUZZ_BYTES_fuzz_campaign := 4000
FUZZ_BYTES_fuzz_clients := 2000
FUZZ_BYTES_fuzz_config := 8000
FUZZ_BYTES_fuzz_control := 4000
FUZZ_BYTES_fuzz_frame := 64
FUZZ_BYTES_fuzz_mac := 1000
FUZZ_BYTES_fuzz_port := 2000
FUZZ_BYTES_fuzz_profiles := 6000
FUZZ_BYTES_fuzz_reload := 5000
FUZZ_BYTES_fuzz_socketcand := 4000
FUZZ_BYTES_fuzz_trace := 4000
fuzz_bytes = $(if $(FUZZ_BYTES_$(1)),-max_len=$(FUZZ_BYTES_$(1)))

# Runs each target; findings, inputs that break something, go to build/fuzz/found/NAME.
FUZZ_EACH = $(shell expr $(FUZZ) / $(words $(FUZZ_TARGETS)) + 1)
fuzz-run: $(addprefix $(BUILD)/,$(FUZZ_TARGETS)) $(CORPORA)
	@$(foreach target,$(FUZZ_TARGETS),echo "== $(target)" && mkdir -p $(BUILD)/found/$(target) && \
	  $(BUILD)/$(target) -max_total_time=$(FUZZ_EACH) -timeout=30 -rss_limit_mb=4096 \
	  -verbosity=0 -print_final_stats=1 -print_funcs=0 -close_fd_mask=1 -use_value_profile=1 \
	  -artifact_prefix=$(BUILD)/found/$(target)- $(call fuzz_bytes,$(target)) \
	  $(BUILD)/found/$(target) \
	  $(call fuzz_seeds,$(target)) &&) true

fuzz-merge-run: $(addprefix $(BUILD)/,$(FUZZ_TARGETS))
	@$(foreach target,$(FUZZ_TARGETS),scripts/fuzz-merge $(BUILD)/$(target) \
	  tests/fuzz/corpus/$(target:fuzz_%=%).tar.gz $(BUILD)/found/$(target) \
	  $(FUZZ_SEEDS_$(target)) &&) true

# The tests that scripts/mutate builds and runs for each changed controller.
MUTANT_TESTS := $(addprefix $(BUILD)/,test_mac test_bus test_contest test_host \
  test_fault_match test_fault_level test_prng test_format test_time test_timed_mac) $(CONFORMANCE)
mutant: $(MUTANT_TESTS)
mutant-run:
	@for test in $(MUTANT_TESTS); do $$test || exit 1; done

# ... and for changed rows of campaigns (scripts/mutate --campaign).
MUTANT_CAMPAIGN := $(addprefix $(BUILD)/,test_number_text test_pairwise test_pool test_rule_slot \
  test_sample test_splice test_valuepath test_variant replay_fuzz_campaign)
mutant-campaign: $(MUTANT_CAMPAIGN) $(BUILD)/corpus/campaign
mutant-campaign-run:
	@for test in $(MUTANT_CAMPAIGN); do $$test $(BUILD)/corpus/campaign || exit 1; done

# In the same way for changed fast paths (scripts/mutate --short-cuts).
mutant-short-cuts: $(DIFFERENTIAL) $(addprefix $(BUILD)/,test_away test_clocks test_hours \
  test_timed_frames)
mutant-short-cuts-run:
	@$(BUILD)/test_timed_frames && $(BUILD)/test_hours && $(BUILD)/test_away && \
	  $(BUILD)/test_clocks
	@$(DIFFERENTIAL) --no-shrink --bits 5000000

$(LIB): $(LIB_OBJECTS)
	@rm -f $@
	$(call tell,AR,$@) $(AR) qcs $@ $^

$(PARTS): $(call objects,$(PARTS_SOURCES))
	@rm -f $@
	$(call tell,AR,$@) $(AR) qcs $@ $^

$(BUILD)/libdev.so: $(call objects,$(PARTS_SOURCES)) $(LCM_OBJECTS) $(LIB_OBJECTS)
	$(call link,-shared) $(DAEMON_LIBS) $(TOOL_LIBS) $(SCREEN_LIBS)

$(DAEMON): $(call objects,daemon/main.c) $(DAEMON_CODE)
	$(call link,$(LINK_LTO)) $(WITH_SHARED) $(DAEMON_LIBS) $(TOOL_LIBS)

$(TOOL): $(call objects,daemon/cli/main.c) $(TOOL_CODE)
	$(call link,$(LINK_LTO)) $(WITH_SHARED) $(TOOL_LIBS) $(SCREEN_LIBS)

# The library that programs preload. A program without sanitizers cannot load one with them, and
# the calls of the C library are its own ones, which _FORTIFY_SOURCE would replace.
PRELOAD_CFLAGS = $(filter-out -fsanitize% -fno-sanitize% --coverage -fPIE -D_FORTIFY_SOURCE%, \
  $(DAEMON_CFLAGS)) -U_FORTIFY_SOURCE -fPIC -fvisibility=hidden -pthread

$(BUILD)/daemon/preload/%.o: daemon/preload/%.c
	@mkdir -p $(@D)
	$(call tell,CC,$<) $(CC) $(PRELOAD_CFLAGS) -c -o $@ $<

$(PRELOAD): $(call objects,$(PRELOAD_SOURCES))
	$(call tell,LD,$@) $(CC) $(PRELOAD_CFLAGS) -shared -Wl,-z,relro -Wl,-z,now -Wl,-z,defs \
	  -Wl,-soname,$(@F) $(filter-out -pie -fPIE,$(LDFLAGS)) -o $@ $^ -ldl

# The buses in virtual time as a library (daemon/embed). Only canwire-sim.h is visible.
# The name of the checkout is not in it, so that wheels are the same from everywhere.
PIC = -fPIC -fvisibility=hidden -ffile-prefix-map=$(CURDIR)=.
SIM_OBJECTS := $(SIM_SOURCES:%.c=$(BUILD)/pic/%.o) $(BUILD)/pic/lib/format/tables.o

$(BUILD)/pic/lib/%.o: lib/%.c | $(LAYOUT)
	@mkdir -p $(@D)
	$(call tell,CC,$<) $(filter-out -fPIE,$(LIB_COMPILE)) $(PIC)

$(BUILD)/pic/lib/format/tables.o: $(GEN)/lib/format/tables.c | $(LAYOUT)
	@mkdir -p $(@D)
	$(call tell,CC,$<) $(filter-out -fPIE,$(LIB_COMPILE)) $(PIC)

$(BUILD)/pic/daemon/%.o: daemon/%.c | $(LAYOUT) $(VERSION_HEADER)
	@mkdir -p $(@D)
	$(call tell,CC,$<) $(CC) $(filter-out -fPIE,$(DAEMON_CFLAGS)) $(PIC) -c -o $@ $<

# A wheel brings the libraries that this one needs, which are beside it there.
WHEEL_SIM := $(BUILD)/wheel/libcanwire-sim.so
$(WHEEL_SIM): SIM_PATH := -Wl,-rpath,'$$ORIGIN'
$(SIM) $(WHEEL_SIM): $(SIM_OBJECTS)
	@mkdir -p $(@D)
	$(call tell,LD,$@) $(CC) $(filter-out -fPIE,$(ALL_CFLAGS)) $(LINK_LTO) $(PIC) -shared \
	  -Wl,-soname,$(@F) -Wl,--gc-sections $(SIM_PATH) $(filter-out -pie,$(HARDEN_LINK)) \
	  $(filter-out -pie -fPIE,$(LDFLAGS)) -o $@ $^ $(SIM_LIBS)

$(USB): $(call objects,daemon/usb/main.c) $(PARTS) $(LIB)
	$(call link,$(LINK_LTO)) -lsystemd $(SIM_LIBS)

# The JSON schemas of all files that people write, from the tables of their readers, and the tables
# of counters.
$(BUILD)/json-schema: $(call objects,$(wildcard daemon/schema/*.c)) $(PARTS) $(LIB)
	$(call link,$(LINK_PLAIN)) $(SIM_LIBS)

$(SCHEMA): $(BUILD)/json-schema
	@mkdir -p $(@D)
	$(call tell,GEN,$(@D)) $(RUN) $< $(@D) $(BUILD)/tables.json

# Scripts that start programs of another architecture in its emulator, for other scripts and tests.
# A shell without a dynamic linker does not complain of a library that only the program can preload.
$(BUILD)/run/%: $(BUILD)/%
	@mkdir -p $(@D)
	@printf '#!/bin/busybox sh\nexec %s %s "$$@"\n' '$(RUN)' '$(CURDIR)/$<' >$@ && chmod 755 $@

$(BUILD)/run/schema: $(SCHEMA)
	@mkdir -p $(@D) && ln -sfnr $(<D) $@ && ln -sfr $(BUILD)/tables.json $(@D)

RUNNERS := $(if $(RUN),$(addprefix $(BUILD)/run/,canwire canwired canwire-usb schema))
build: $(RUNNERS)
# The folder of the programs as this machine can start them.
STARTED := $(BUILD)$(if $(RUN),/run)

$(BUILD)/man/%: daemon/man/%.md scripts/man $(DAEMON) $(TOOL) $(USB) $(wildcard systemd/*.conf) \
  $(SCHEMA) $(wildcard config/*.yaml config/lcm/*.lcm) $(RUNNERS)
	@mkdir -p $(@D)
	@scripts/man --build $(STARTED) $< >$@

$(CONFORMANCE): $(call objects,$(wildcard tests/conformance/*.c)) $(LIB)
	$(call link,$(LINK_PLAIN))

$(DIFFERENTIAL): $(call objects,$(wildcard tests/differential/*.c)) $(LIB)
	$(call link,$(LINK_PLAIN))

$(MUTANTS): $(call objects,$(wildcard tests/mutants/*.c)) $(PARTS) $(LIB)
	$(call link,$(LINK_PLAIN)) $(DAEMON_LIBS) $(TOOL_LIBS)

# The objects that run the scenarios of the differential test, without those that compare.
DIGEST_PARTS := $(filter-out \
  $(addprefix tests/differential/,main.c coverage.c compare.c show.c shrink.c), \
  $(wildcard tests/differential/*.c))
$(BUILD)/digest: $(call objects,tests/determinism/digest.c $(DIGEST_PARTS)) $(LIB)
	$(call link,$(LINK_PLAIN))

# canwired in a simulated world: its code and libev's call seam_NAME for each NAME in `calls`, and
# its own work is counted. All other calls must be on the list of harmless ones (check-calls).
WORLD := $(BUILD)/world
LIBEV_ARCHIVE := $(shell $(CC) -print-file-name=libev.a)
WORLD_PROGRAMS := $(call objects,$(DAEMON_SOURCES) daemon/cli/main.c $(PARTS_SOURCES)) \
  $(LIB_OBJECTS)
ifneq ($(filter world worldsan,$(VARIANT)),)
$(WORLD_PROGRAMS): ALL_CFLAGS += -fsanitize-coverage=trace-pc
endif

$(BUILD)/world-syms: tests/world/calls
	@mkdir -p $(@D)
	@sed -n 's/^[a-z].*/& seam_&/p' $< >$@

$(BUILD)/canwired.o: $(call objects,$(DAEMON_SOURCES)) $(LIB_OBJECTS) $(LCM_OBJECTS) \
  $(LIBEV_ARCHIVE) $(BUILD)/world-syms
	@ld -r -o $@ $(filter %.o,$^) --whole-archive $(LIBEV_ARCHIVE)
	@objcopy --redefine-sym main=canwired_main --redefine-syms=$(BUILD)/world-syms \
	  --keep-global-symbol=canwired_main $@

$(BUILD)/canwire.o: $(call objects,daemon/cli/main.c) $(PARTS) $(LIB)
	@ld -r -o $@ $^
	@objcopy --redefine-sym main=canwire_main --keep-global-symbol=canwire_main $@

$(WORLD): $(call objects,$(wildcard tests/world/*.c)) $(BUILD)/canwired.o $(BUILD)/canwire.o
	@scripts/world-calls $(BUILD)/canwired.o
	$(call link,) -llcm -lsystemd -lm $(TOOL_LIBS) $(SCREEN_LIBS)

$(BUILD)/bench: $(call objects,$(wildcard tests/bench/speed/*.c)) $(LIB)
	$(call link,$(LINK_LTO))

# The library is the one that programs get.
$(BUILD)/bench_sim: $(call objects,$(wildcard tests/bench/embed/*.c)) $(SIM)
	$(call link,) -Wl,-rpath,'$$ORIGIN'

REALTIME_OBJECTS := $(call objects,$(wildcard tests/bench/realtime/*.c))
$(BUILD)/bench_realtime: $(REALTIME_OBJECTS) $(PARTS) $(LCM_OBJECTS) $(LIB)
	$(call link,$(LINK_LTO)) $(DAEMON_LIBS) $(TOOL_LIBS)

.SECONDEXPANSION:
$(UNIT_TESTS:%=$(BUILD)/%): $$(call objects,$$(filter %/$$(@F).c,$(UNIT_SOURCES)) \
  tests/unit/cases.c) $(DAEMON_CODE)
	$(call link,$(LINK_PLAIN)) $(WITH_SHARED) $(DAEMON_LIBS) \
	  $(TOOL_LIBS) -lcmocka

FUZZ_SHARED := $(filter-out tests/fuzz/fuzz_%.c tests/fuzz/replay.c,$(wildcard tests/fuzz/*.c))
FUZZ_OBJECTS = $(BUILD)/tests/fuzz/fuzz_%.o $(call objects,$(FUZZ_SHARED)) $(PARTS) $(LIB)

$(BUILD)/fuzz_%: $(FUZZ_OBJECTS)
	$(call link,$(LINK_PLAIN) -fsanitize=fuzzer) \
	  $(DAEMON_LIBS) $(TOOL_LIBS)

$(BUILD)/replay_fuzz_%: $(BUILD)/tests/fuzz/replay.o $(FUZZ_OBJECTS)
	$(call link,$(LINK_PLAIN)) $(DAEMON_LIBS) $(TOOL_LIBS)

# The engine is optimised for speed. gcc links it as a whole, since it is small functions in many
# files; for tests that takes too long (LTO=no). Two counters side by side are cheaper one by one
# than as a vector.
ifeq ($(VARIANT),release)
LIB_FLAGS := -O3 -fno-tree-slp-vectorize
IS_GCC := $(shell $(CC) -v 2>&1 | grep -q '^gcc version' && echo yes)
# An installation is linked as a whole; other targets leave a folder as it is.
LTO ?= $(or $(if $(filter install,$(MAKECMDGOALS)),yes),$(file <$(BUILD)/lto),yes)
PGO ?= $(file <$(BUILD)/pgo)
$(LIB_OBJECTS) $(SIM_OBJECTS): $(BUILD)/lto $(BUILD)/pgo
$(BUILD)/lto: MODE = $(LTO)
$(BUILD)/pgo: MODE = $(PGO)
$(BUILD)/lto $(BUILD)/pgo: always
	@mkdir -p $(@D)
	@echo '$(MODE)' | cmp -s - $@ || echo '$(MODE)' >$@
always:
endif
INLINING := --param max-inline-insns-auto=200 --param inline-unit-growth=300

# PGO=1: gcc compiles the engine by what it has counted in a build of its own. So it knows what is
# rare, and a clean frame takes a tenth fewer instructions. The training is a bit of all works of
# the bench, and more of what users simulate most. The same training, compiler and sources give the
# same programs. The counts lie beside the objects.
TRAINING := --check "mix 30" "faulted-10 20000" "begin 5000"
PROFILE = -dumpdir $(PROFILES)/$(<D)/ -dumpbase $(<F) -dumpbase-ext .c -MF $(@:.o=.d)
ifeq ($(VARIANT),train)
LIB_FLAGS = -O3 -fno-tree-slp-vectorize $(INLINING) -fprofile-generate $(PROFILE)
LINK_LTO := -fprofile-generate
endif
ifeq ($(VARIANT)$(PGO),release1)
ifneq ($(IS_GCC),yes)
$(error PGO=1 needs gcc)
endif
TRAINED := $(BUILD)/trained
PROFILES := $(BUILD)
LIB_FLAGS += -fprofile-use -Wno-missing-profile
$(filter $(BUILD)/pic/lib/%,$(SIM_OBJECTS)): PIC += $(PROFILE)
$(LIB_OBJECTS) $(SIM_OBJECTS): $(TRAINED)
$(TRAINED): $(LIB_SOURCES) $(wildcard lib/*.h lib/*/*.h tests/bench/speed/*) | $(LAYOUT)
	@$(MAKE) --no-print-directory VARIANT=train BUILD=$(BUILD)/train PROFILES=$(BUILD) PGO= \
	  $(BUILD)/train/bench
	@find $(BUILD) -name '*.gcda' -delete
	$(call tell,RUN,$(BUILD)/train/bench) for work in $(TRAINING); do \
	  $(RUN) $(BUILD)/train/bench $$work >/dev/null || exit 1; done
	@touch $@
endif

ifeq ($(IS_GCC)$(LTO),yesyes)
# gcc does not tell the assembler of -ffile-prefix-map for these objects: packages would not be the
# same from everywhere.
LIB_FLAGS += -flto -ffat-lto-objects $(INLINING) -Wa,--debug-prefix-map=$(CURDIR)=.
LINK_LTO := -flto=auto $(INLINING)
LINK_PLAIN := -fno-use-linker-plugin # tests use the engine's separate objects: they link faster
endif

LIB_COMPILE = $(CC) $(ALL_CFLAGS) $(LIB_FLAGS) $(LIB_EXEMPT) -c -o $@ $<

$(BUILD)/lib/%.o: lib/%.c | $(LAYOUT)
	@mkdir -p $(@D)
	$(call tell,CC,$<) $(LIB_COMPILE)

$(BUILD)/lib/format/tables.o: $(GEN)/lib/format/tables.c | $(LAYOUT)
	@mkdir -p $(@D)
	$(call tell,CC,$<) $(LIB_COMPILE)

# A program of this machine generates tables from the table of frame parts.
FORMAT_SOURCES := lib/format/generate/main.c lib/format/parts.c lib/format/frame.c
$(GEN)/lib/format/generate: $(FORMAT_SOURCES) $(wildcard lib/format/*.h) $(wildcard lib/*.h)
	@mkdir -p $(@D)
	$(call tell,CC,$@) $(HOSTCC) -std=c17 $(WARNINGS) -Ilib -o $@ $(FORMAT_SOURCES)

$(LAYOUT): $(GEN)/lib/format/generate
	@$< layout >$@

$(GEN)/lib/format/tables.c: $(GEN)/lib/format/generate
	@$< tables >$@

# A header of its own: a new version compiles only the files that tell it.
$(VERSION_HEADER): Makefile
	@mkdir -p $(@D)
	@line='#define CANWIRE_VERSION "$(VERSION)"'; \
	  [ "$$(cat $@ 2>/dev/null)" = "$$line" ] || echo "$$line" >$@

$(BUILD)/daemon/%.o: daemon/%.c | $(LCM_SOURCES) $(VERSION_HEADER)
	@mkdir -p $(@D)
	$(call tell,CC,$<) $(CC) $(DAEMON_CFLAGS) -c -o $@ $<

# Newer versions of cmocka have other names for the functions of older ones.
$(BUILD)/tests/%.o: tests/%.c | $(LAYOUT) $(VERSION_HEADER)
	@mkdir -p $(@D)
	$(call tell,CC,$<) $(CC) $(DAEMON_CFLAGS) -Wno-deprecated-declarations \
	  -Itests/unit -DTESTS_DIR='"$(CURDIR)/tests"' -c -o $@ $<

# Generated code is not compiled with our warnings.
$(BUILD)/gen/%.o: $(GEN)/%.c
	@mkdir -p $(@D)
	$(call tell,CC,$<) $(CC) $(filter-out $(WARNINGS),$(ALL_CFLAGS)) -I$(GEN) -c -o $@ $<

$(GEN)/canwire_%.c: config/lcm/%.lcm
	@mkdir -p $(GEN)
	$(call tell,GEN,$@) lcm-gen --lazy -c --c-cpath $(GEN) --c-hpath $(GEN) --cinclude '' $<
	@touch $@

.SECONDARY:
-include $(shell find $(BUILD) -name '*.d' -type f 2>/dev/null)
