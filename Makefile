# Azulejo's one Makefile. `make help` lists what a person may want.
#
#   make            the programs, into build/release/bin
#   make SANITIZE=address,undefined ...   a separate tree with sanitizers
#   make DEBUG=1 ...                      a separate tree without optimisation
#   make SAFEGUARDS=1 ...                 a separate tree whose safeguards can be switched off
#   make DOUBLE=1 ...                     a separate tree whose renderer computes in double
#   make WEB=0 ...                        a separate tree without the page and its API (no libwebsockets)
#   make V=1 ...                          print whole commands

PREFIX ?= /usr/local
DESTDIR ?=
CC ?= cc
ifeq ($(origin CXX),default)
  CXX := $(if $(findstring clang,$(CC)),$(subst clang,clang++,$(CC)),g++)
endif
OBJCOPY ?= objcopy
PKG_CONFIG ?= pkg-config
PROTOC_C ?= protoc-c
VERSION := 0.2.0

SANITIZE ?=
DEBUG ?=
SAFEGUARDS ?=
DOUBLE ?=
WEB ?= 1
comma := ,
ifneq ($(SANITIZE),)
  VARIANT := $(subst $(comma),-,$(SANITIZE))
  OPTIMISE := -O1 -g -fno-omit-frame-pointer -fsanitize=$(SANITIZE)
  ifneq ($(findstring undefined,$(SANITIZE)),)
    OPTIMISE += -fno-sanitize-recover=undefined
  endif
else ifneq ($(DEBUG),)
  VARIANT := debug
  OPTIMISE := -O0 -g3
else
  VARIANT := release
  OPTIMISE := -O3 -g
endif
ifneq ($(SAFEGUARDS),)
  VARIANT := $(VARIANT:release=)safeguards
  CPPFLAGS += -DAZULEJO_SAFEGUARDS
endif
ifneq ($(DOUBLE),)
  VARIANT := $(VARIANT:release=)double
endif
ifneq ($(WEB),1)
  VARIANT := $(VARIANT:release=)noweb
endif
ifeq ($(findstring clang,$(CC)),clang)
  VARIANT := $(VARIANT)-clang
endif

# What a recipe prints: `CC path`, or with V=1 the command itself.
V ?=
ifneq ($(findstring s,$(firstword -$(MAKEFLAGS))),)
  show = @
else ifeq ($(V),)
  show = @printf '  %-7s %s\n' $(1) $(patsubst $(BUILD)/%,%,$@);
else
  show =
endif

BUILD := build/$(VARIANT)
GEN := build/gen

PACKAGES := libuv openssl sqlite3 jansson libpng zlib libdeflate libjpeg libwebp libzstd libprotobuf-c OpenEXR
# Embree ships no .pc file in Debian: take 4 where its header is, else 3.
hash := \#
EMBREE := $(shell echo '$(hash)include <embree4/rtcore.h>' | $(CC) -E -x c - >/dev/null 2>&1 && echo 4 || echo 3)

WARNINGS := -Wall -Wextra -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wold-style-definition \
  -Wpointer-arith -Wwrite-strings -Wundef -Wvla -Wformat=2 -Werror
CPPFLAGS += -D_GNU_SOURCE -DAZULEJO_EMBREE=$(EMBREE) -I. -I$(GEN)
# System headers are not ours to warn about.
CPPFLAGS += $(patsubst -I%,-isystem %,$(shell $(PKG_CONFIG) --cflags $(PACKAGES) 2>/dev/null))
# The determinism contract: no contraction, no fast-math (docs/NUMERICS.md).
CFLAGS += -std=c17 $(OPTIMISE) -ffp-contract=off -fno-math-errno -fno-trapping-math -fPIC -pthread $(WARNINGS)
# What wraps a C++ library behind a C interface.
CXXFLAGS += -std=c++17 $(OPTIMISE) -fPIC -pthread -Wall -Wextra -Wshadow -Werror
LDFLAGS += $(OPTIMISE) -pthread
LIBS_COMMON := $(shell $(PKG_CONFIG) --libs libpng zlib libdeflate libjpeg libwebp libzstd libprotobuf-c openssl OpenEXR 2>/dev/null) -lm
LIBS_PROTOCOL := $(shell $(PKG_CONFIG) --libs libuv 2>/dev/null)
LIBS_COORDINATOR := $(shell $(PKG_CONFIG) --libs sqlite3 2>/dev/null)
ifeq ($(WEB),1)
LIBS_WEB := $(shell $(PKG_CONFIG) --libs libwebsockets jansson 2>/dev/null)
endif
# Draco is C++. The archive where there is one: its symbols need no search at each start of the client.
DRACO := $(shell a=$$($(CC) -print-file-name=libdraco.a); [ -e "$$a" ] && echo "$$a" || echo -ldraco)
LIBS_CLIENT := $(shell $(PKG_CONFIG) --libs jansson 2>/dev/null) $(DRACO) -lstdc++
LIBS_RENDER := -lembree$(EMBREE)
LIBS_ALL := $(LIBS_COMMON) $(LIBS_PROTOCOL) $(LIBS_COORDINATOR) $(LIBS_WEB) $(LIBS_CLIENT) $(LIBS_RENDER)

# ---- what there is ------------------------------------------------------------------------
sources = $(sort $(shell find $(1) -name '*.c' 2>/dev/null))
COMMON_SRC := $(call sources,common)
PROTOCOL_SRC := $(call sources,protocol)
RENDER_SRC := $(call sources,worker/render)
COORDINATOR_SRC := $(filter-out coordinator/main.c,$(call sources,coordinator))
# The page's program and the coordinator's part in it, which a build without the page leaves out.
WEB_ASSETS := $(sort $(shell find web/assets -type f 2>/dev/null))
ifeq ($(WEB),1)
WEB_SRC := $(filter-out web/main.c,$(call sources,web))
$(BUILD)/obj/coordinator/main.o: CPPFLAGS += -DAZULEJO_WEB
else
COORDINATOR_SRC := $(filter-out coordinator/page/%,$(COORDINATOR_SRC))
endif
WORKER_SRC := $(filter-out worker/main.c worker/render/%,$(call sources,worker))
CLIENT_SRC := $(filter-out client/main.c,$(call sources,client))
PROTOS := protocol/azulejo.proto common/scene/scene.proto
PROTO_SRC := $(PROTOS:%.proto=$(GEN)/%.pb-c.c)
PROTO_HDR := $(PROTOS:%.proto=$(GEN)/%.pb-c.h)

object = $(patsubst %.c,$(BUILD)/obj/%.o,$(1))
cxx_objects = $(patsubst %.cc,$(BUILD)/obj/%.o,$(sort $(shell find $(1) -name '*.cc')))
# Generated code keeps its own path below build/gen.
gen_object = $(patsubst $(GEN)/%.c,$(BUILD)/obj/gen/%.o,$(1))

LIB_COMMON := $(BUILD)/lib/libcommon.a
LIB_PROTOCOL := $(BUILD)/lib/libprotocol.a
LIB_RENDER := $(BUILD)/lib/librender.a
LIB_COORDINATOR := $(BUILD)/lib/libcoordinator.a
LIB_WORKER := $(BUILD)/lib/libworker.a
LIB_CLIENT := $(BUILD)/lib/libclient.a
ifeq ($(WEB),1)
LIB_WEB := $(BUILD)/lib/libweb.a
endif
LIB_SCENES := $(BUILD)/lib/libscenes.a
LIBRARIES := $(LIB_SCENES) $(LIB_CLIENT) $(LIB_WEB) $(LIB_COORDINATOR) $(LIB_WORKER) $(LIB_RENDER) $(LIB_PROTOCOL) $(LIB_COMMON)

BIN := $(BUILD)/bin
PROGRAMS := $(BIN)/azulejo $(BIN)/azulejo-coordinator $(BIN)/azulejo-worker
ifeq ($(WEB),1)
PROGRAMS += $(BIN)/azulejo-web
endif
# What several generators share: every other .c file under scenes.
SCENE_SHARED := $(foreach c,$(call sources,scenes),$(if $(filter make_%,$(notdir $(c))),,$(c)))
SCENE_TOOLS := $(patsubst scenes/%.c,$(BIN)/scenes/%,$(filter-out $(SCENE_SHARED),$(call sources,scenes)))

# These are compiled with another table of material fields, of settings or of work counters (below).
ROW_TEST_SRC := tests/unit/scene/test_material_row.c
SETTING_ROW_TEST_SRC := tests/unit/schema/test_setting_row.c
COUNTER_ROW_TEST_SRC := tests/unit/film/test_counter_row.c
# Tests of the page's room, which a build without it skips by name.
ifneq ($(WEB),1)
WEB_TEST_SRC := $(shell grep -rl '"web/' tests --include='*.c' 2>/dev/null)
endif
TEST_SRC := $(filter-out $(WEB_TEST_SRC),$(foreach d,unit statistics numerics,$(shell find tests/$(d) -name 'test_*.c' 2>/dev/null)))
# And this one with a path tracer that goes wrong on purpose.
FAULT_TEST_SRC := tests/unit/render/test_health.c
TESTS := $(patsubst %.c,$(BUILD)/%,$(sort $(filter-out $(ROW_TEST_SRC) $(SETTING_ROW_TEST_SRC) $(COUNTER_ROW_TEST_SRC) $(FAULT_TEST_SRC),$(TEST_SRC))))
# Helpers of tests: any other .c file under tests/support.
SUPPORT_SRC := $(call sources,tests/support)
LIB_SUPPORT := $(BUILD)/lib/libsupport.a
# Programs that the farm tests and benchmarks drive.
TOOL_SRC := $(sort $(shell find tests/farm tests/bench tests/accuracy tests/fuzz -name '*.c' ! -name 'fuzz_*.c' ! -name odd_disk.c ! -name odd_calls.c ! -name odd_clock.c ! -name odd_reach.c ! -name liar.c ! -name resting.c ! -name clients.c 2>/dev/null))
# Preloaded into programs under test.
ODD_LIBRARIES := $(patsubst %,$(BUILD)/tests/farm/odd_%.so,disk calls clock reach)
# The worker with another render_tile.
ODD_WORKERS := $(BUILD)/tests/farm/liar $(BUILD)/tests/farm/resting
# The client that forks for each command.
CLIENTS := $(BUILD)/tests/farm/clients
TOOLS := $(patsubst %.c,$(BUILD)/%,$(TOOL_SRC))
FUZZ_SRC := $(sort $(filter-out $(WEB_TEST_SRC),$(shell find tests/fuzz -name 'fuzz_*.c' 2>/dev/null)))
FUZZ_REPLAY := $(patsubst %.c,$(BUILD)/%_replay,$(FUZZ_SRC))
FUZZERS := $(patsubst tests/fuzz/%.c,build/fuzz/%,$(FUZZ_SRC))

.DEFAULT_GOAL := all
.PHONY: all help deps demo test test-blender test-slurm test-web blender-addon accuracy accuracy-unbiased accuracy-allocation accuracy-time accuracy-targets accuracy-prices accuracy-fresh check-asan check-tsan fault-loop chaos check test-elsewhere steady fuzz bench bench-effects bench-denoise bench-preview bench-accuracy bench-scale bench-farm bench-page studio-day layers circles fields words budget tables docs-check docs-html gallery test-docs numerics mistakes invariance transforms precision install uninstall dist clean tests lint format layout new-lobe new-tonemap test-new
.SECONDARY:
.DELETE_ON_ERROR:

all: $(PROGRAMS) $(SCENE_TOOLS) ## build the programs and the scene generators

help: ## this list
	@grep -E '^[a-z-]+:.*##' Makefile | sed -E 's/:.*## /\t/' | expand -t 14

deps: ## install what is missing (Debian 12; says what it would do elsewhere)
	@scripts/install-deps.sh --tests

# ---- compile ------------------------------------------------------------------------------
$(GEN)/%.pb-c.c $(GEN)/%.pb-c.h: %.proto
	@mkdir -p $(GEN)
	$(call show,PROTOC)$(PROTOC_C) --c_out=$(GEN) $<

# What /api/v1/openapi.yaml answers: from the routes that the page's own objects print, and the schema.
$(BUILD)/gen/openapi_routes: $(BUILD)/obj/scripts/openapi_routes.o $(call object,$(WEB_SRC)) $(LIB_PROTOCOL) $(LIB_COMMON)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ $(LIBS_WEB) $(LIBS_PROTOCOL) $(LIBS_COMMON)
$(BUILD)/gen/azulejo.descriptors: protocol/azulejo.proto
	@mkdir -p $(@D)
	$(call show,PROTOC)$(PROTOC_C) --include_source_info --descriptor_set_out=$@ $<
$(BUILD)/gen/openapi.yaml: $(BUILD)/gen/openapi_routes $(BUILD)/gen/azulejo.descriptors scripts/openapi.py
	$(call show,GEN)$(BUILD)/gen/openapi_routes | scripts/openapi.py $(BUILD)/gen/azulejo.descriptors >$@
$(BUILD)/gen/web_assets.c: $(WEB_ASSETS) web/assets/. $(BUILD)/gen/openapi.yaml scripts/embed.py
	$(call show,EMBED)scripts/embed.py $@ web/assets $(BUILD)/gen/openapi.yaml
$(BUILD)/obj/gen/web_assets.o: $(BUILD)/gen/web_assets.c
	@mkdir -p $(@D)
	$(call show,CC)$(CC) $(CPPFLAGS) $(CFLAGS) -MMD -MP -c -o $@ $<

$(BUILD)/obj/gen/%.o: $(GEN)/%.c
	@mkdir -p $(@D)
	$(call show,CC)$(CC) $(CPPFLAGS) $(filter-out $(WARNINGS),$(CFLAGS)) -MMD -MP -c -o $@ $<

# Unit tests run once, and spend their time in the libraries: optimising them costs more than it saves. The other tests
# compute for themselves.
ifeq ($(SANITIZE)$(DEBUG),)
$(BUILD)/obj/tests/%.o: CFLAGS += -g1
$(BUILD)/obj/tests/unit/%.o: CFLAGS += -O1
# Without -S each of 290 programs holds the libraries' debug information: three quarters of its size, half of the linker's
# time. For a debugger there is DEBUG=1. gold takes half as long as ld; Debian's binutils have both.
TEST_LDFLAGS := -Wl,-S $(shell command -v ld.gold >/dev/null && echo -fuse-ld=gold)
endif

# Nothing in the renderer is replaced at run time. gcc sets and copies structures by `rep stos` and `rep movs`, whose start
# takes longer than all of the 200 bytes that most have here.
$(BUILD)/obj/worker/render/%.o: CFLAGS += -fno-semantic-interposition $(RENDER_CFLAGS)
ifeq ($(shell $(CC) -dumpmachine | grep -c ^x86_64)$(findstring clang,$(CC)),1)
RENDER_CFLAGS := $(foreach how,memset memcpy,-m$(how)-strategy=vector_loop:1024:noalign$(comma)libcall:-1:noalign)
endif
$(BUILD)/obj/worker/render/bsdf/albedo_table.o: worker/render/bsdf/albedo_table.bin
# common/math/real.h. Only the worker computes in double: scenes are imported and films merged by the same
# arithmetic. A float where a double was meant would hide what is to be measured, so narrowing needs a cast.
ifneq ($(DOUBLE),)
$(BUILD)/obj/worker/%.o $(BUILD)/obj/tests/bench/bench_render.o: CPPFLAGS += -DAZULEJO_DOUBLE
$(BUILD)/obj/worker/render/%.o: CFLAGS += -Wfloat-conversion -Wno-psabi
endif

# A kernel: everything that runs at a path's vertices, compiled as one piece with KERNEL_EFFECTS a constant
# (worker/render/base/has.h), and its row of the table (tile.c) the only name that others see. One for each row
# of KERNEL_MAP, and one that records paths (worker/render/path/record_path.h). The same files, compiled each on
# its own, are what the rest of the renderer and the tests call.
KERNEL_SRC := $(addprefix worker/render/,bsdf/bsdf.c camera/camera.c surface/surface.c surface/surface_shade.c \
  surface/surface_texture.c light/emitters_sample.c light/triangle_light.c path/path.c path/path_alpha.c path/path_caustic.c path/path_light.c path/path_on.c \
  path/path_trace.c path/path_volumes.c path/tile.c)
KERNEL_ROWS := $(subst $(comma),=,$(shell sed -nE 's/^    X\(([a-z]+), ([A-Z_]+)\).*/\1,\2/p' common/scene/kernel_sets.h)) recording=KERNEL_SET_GENERAL
KERNEL_OBJ := $(foreach row,$(KERNEL_ROWS),$(BUILD)/obj/worker/render/kernel/$(firstword $(subst =, ,$(row))).o)
$(BUILD)/obj/worker/render/kernel/recording.o: CPPFLAGS += -DKERNEL_RECORDS=1
ifeq ($(findstring clang,$(CC)),)
# gcc's limits on what it inlines are meant for larger programs' sake.
KERNEL_CFLAGS := -fwhole-program --param inline-unit-growth=300 --param large-unit-insns=100000 --param large-function-growth=1000
endif
# $(1): the set of effects.
define kernel
	@mkdir -p $(@D)
	$(call show,KERNEL)$(CC) $(CPPFLAGS) -DKERNEL_NAME='"$(basename $(@F))"' -DKERNEL_EFFECTS=$(1) $(CFLAGS) $(KERNEL_CFLAGS) -MMD -MP -c -o $@ \
	  $(addprefix -include ,$(filter-out %/tile.c,$(KERNEL_SRC))) $(filter %/tile.c,$(KERNEL_SRC))
	@$(OBJCOPY) --redefine-sym kernel_row=kernel_$(basename $(@F)) --keep-global-symbol=kernel_$(basename $(@F)) $@
endef
$(KERNEL_OBJ): $(KERNEL_SRC) Makefile | $(PROTO_HDR)
	$(call kernel,$(patsubst $(basename $(@F))=%,%,$(filter $(basename $(@F))=%,$(KERNEL_ROWS))))

$(BUILD)/obj/%.o: %.c | $(PROTO_HDR)
	@mkdir -p $(@D)
	$(call show,CC)$(CC) $(CPPFLAGS) $(CFLAGS) -MMD -MP -c -o $@ $<

$(BUILD)/obj/%.o: %.cc
	@mkdir -p $(@D)
	$(call show,CXX)$(CXX) -I. $(CXXFLAGS) -MMD -MP -c -o $@ $<

# What names the release is compiled again when it changes: programs of two releases refuse each other.
VERSIONED := $(shell grep -rl AZULEJO_VERSION --include='*.c' client common coordinator protocol web worker)
VERSIONED_OBJ := $(patsubst %.c,$(BUILD)/obj/%.o,$(VERSIONED)) $(patsubst %.c,$(BUILD)/row/obj/%.o,$(VERSIONED)) $(patsubst %.c,$(BUILD)/row/verb/obj/%.o,$(VERSIONED))
$(VERSIONED_OBJ): CPPFLAGS += -DAZULEJO_VERSION='"$(VERSION)"'
$(VERSIONED_OBJ): $(BUILD)/version
.PHONY: always
$(BUILD)/version: always
	@mkdir -p $(@D)
	@echo '$(VERSION)' | cmp -s - $@ || echo '$(VERSION)' >$@

define archive
	@mkdir -p $(@D)
	@rm -f $@
	$(call show,AR)$(AR) rcs $@ $^
endef
$(LIB_COMMON): $(call object,$(COMMON_SRC)) $(BUILD)/obj/gen/common/scene/scene.pb-c.o ; $(archive)
$(LIB_PROTOCOL): $(call object,$(PROTOCOL_SRC)) $(BUILD)/obj/gen/protocol/azulejo.pb-c.o ; $(archive)
$(LIB_RENDER): $(call object,$(RENDER_SRC)) $(KERNEL_OBJ) ; $(archive)
$(LIB_COORDINATOR): $(call object,$(COORDINATOR_SRC)) ; $(archive)
$(LIB_WEB): $(call object,$(WEB_SRC)) $(BUILD)/obj/gen/web_assets.o ; $(archive)
$(LIB_WORKER): $(call object,$(WORKER_SRC)) ; $(archive)
$(LIB_CLIENT): $(call object,$(CLIENT_SRC)) $(call cxx_objects,client) ; $(archive)
$(LIB_SUPPORT): $(call object,$(SUPPORT_SRC)) $(call cxx_objects,tests/support) ; $(archive)
$(LIB_SCENES): $(call object,$(SCENE_SHARED)) ; $(archive)

# ---- link: each program sees only what ARCHITECTURE allows it -------------------------------
$(BIN)/azulejo: $(call object,client/main.c) $(LIB_CLIENT) $(LIB_PROTOCOL) $(LIB_COMMON)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ $(LIBS_CLIENT) $(LIBS_PROTOCOL) $(LIBS_COMMON)
$(BIN)/azulejo-coordinator: $(call object,coordinator/main.c) $(LIB_COORDINATOR) $(LIB_PROTOCOL) $(LIB_COMMON)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ $(LIBS_COORDINATOR) $(LIBS_PROTOCOL) $(LIBS_COMMON)
$(BIN)/azulejo-web: $(call object,web/main.c) $(LIB_WEB) $(LIB_PROTOCOL) $(LIB_COMMON)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ $(LIBS_WEB) $(LIBS_PROTOCOL) $(LIBS_COMMON)
$(BIN)/azulejo-worker: $(call object,worker/main.c) $(LIB_WORKER) $(LIB_RENDER) $(LIB_PROTOCOL) $(LIB_COMMON)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ $(LIBS_RENDER) $(LIBS_PROTOCOL) $(LIBS_COMMON)
$(BUILD)/tests/farm/liar: ALSO_WRAPPED := ,--wrap=clock_thread_cpu_ns
$(ODD_WORKERS): $(BUILD)/%: $(BUILD)/obj/%.o $(call object,worker/main.c) $(LIB_WORKER) $(LIB_RENDER) $(LIB_PROTOCOL) $(LIB_COMMON)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -Wl,--wrap=render_tile$(ALSO_WRAPPED) -o $@ $^ $(LIBS_RENDER) $(LIBS_PROTOCOL) $(LIBS_COMMON)
$(CLIENTS): $(call object,client/main.c tests/farm/clients.c) $(LIB_CLIENT) $(LIB_PROTOCOL) $(LIB_COMMON)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -Wl,--wrap=main,-z,now -o $@ $^ $(LIBS_CLIENT) $(LIBS_PROTOCOL) $(LIBS_COMMON)
$(BIN)/scenes/%: $(BUILD)/obj/scenes/%.o $(call object,$(SCENE_SHARED)) $(LIB_COMMON)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ $(LIBS_COMMON) $(LIBS_CLIENT)

$(TESTS): $(call object,tests/support/filter.c)
$(TESTS) $(TOOLS): $(BUILD)/%: $(BUILD)/obj/%.o $(LIB_SUPPORT) $(LIBRARIES)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) $(TEST_LDFLAGS) -o $@ $^ -lcmocka $(LIBS_ALL)

# One material field and one texture more than material_fields.h and scene.proto have, and all that
# treats the fields alike compiled with them: a new row needs no other edit.
ROW := $(BUILD)/row
ROW_TEST := $(ROW_TEST_SRC:%.c=$(BUILD)/%)
ROW_SRC := $(ROW_TEST_SRC) tests/support/scene_sample.c $(call sources,common/scene) client/import/gltf/gltf_meshes.c \
  worker/render/scene/render_material.c worker/render/surface/surface.c worker/render/surface/surface_shade.c worker/render/surface/surface_texture.c
ROW_OBJ := $(patsubst %.c,$(ROW)/obj/%.o,$(ROW_SRC)) $(ROW)/common/scene/scene.pb-c.o
MATERIAL_ROW_VALUE := VALUE(NUMBER, clearcoat_varnish, 0.25f, 0, 2, NONE, CLEARCOAT, 998)
MATERIAL_ROW_TEXTURE := TEXTURE(clearcoat_varnish, DATA, FILTERED, READ_BY_LIT, WITH(clearcoat), CLEARCOAT, 999, FACTOR, PART(clearcoat_varnish, RED))
$(ROW)/common/scene/material_fields.h: common/scene/material_fields.h Makefile
	@mkdir -p $(@D)
	$(call show,GEN)sed 's/^    VALUE(NUMBER, clearcoat_ior,/    $(MATERIAL_ROW_VALUE) $(MATERIAL_ROW_TEXTURE) \\\n&/' $< >$@
$(ROW)/common/scene/scene.proto: common/scene/scene.proto Makefile
	@mkdir -p $(@D)
	$(call show,GEN)sed 's/^  TextureSlot normal_texture = 7;/&\n  float varnish = 998;\n  TextureSlot varnish_texture = 999;/' $< >$@
$(ROW)/common/scene/scene.pb-c.c $(ROW)/common/scene/scene.pb-c.h: $(ROW)/common/scene/scene.proto
	$(call show,GEN)cd $(ROW) && $(PROTOC_C) --c_out=. common/scene/scene.proto
$(ROW)/common/scene/scene.pb-c.o: $(ROW)/common/scene/scene.pb-c.c
	$(call show,CC)$(CC) -I$(ROW) $(CPPFLAGS) $(filter-out $(WARNINGS),$(CFLAGS)) -MMD -MP -c -o $@ $<
$(ROW)/obj/%.o: %.c | $(ROW)/common/scene/material_fields.h $(ROW)/common/scene/scene.pb-c.h $(PROTO_HDR)
	@mkdir -p $(@D)
	$(call show,CC)$(CC) -I$(ROW) $(CPPFLAGS) $(CFLAGS) -O1 -MMD -MP -c -o $@ $<
$(ROW_TEST): $(ROW_OBJ) $(LIB_SUPPORT) $(LIBRARIES)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ -lcmocka $(LIBS_ALL)

# The same for render settings, a number and a choice, last in the struct, and for a work counter: what treats them alike,
# and what holds them on the way there.
SETTING_ROW := $(ROW)/setting
SETTING_ROW_TEST := $(filter $(TEST_SRC:%.c=$(BUILD)/%),$(SETTING_ROW_TEST_SRC:%.c=$(BUILD)/%))
COUNTER_ROW_TEST := $(COUNTER_ROW_TEST_SRC:%.c=$(BUILD)/%)
COUNTER_ROW_SRC := common/scene/settings.c common/scene/manifest.c protocol/message.c protocol/json/json_wire.c $(call sources,common/film) \
  $(wildcard coordinator/pictures/develop*.c)
SETTING_ROW_SRC := $(COUNTER_ROW_SRC) client/options/job_options.c client/options/schedule_option.c web/uploads/import_check.c
SETTING_ROW_OBJ := $(SETTING_ROW)/protocol/azulejo.pb-c.o
SETTING_ROWS := SETTING(o, NUMBER, float, haze, 0.5, 0.1, 2, LISTED, "azulejo:haze", "haze", "X", "haze (default 0.5)") \
  SETTING(o, CHOICE, enum sampler_kind, dust, SAMPLER_INDEPENDENT, 0, 0, LISTED, "azulejo:dust", "dust", "HOW", \
  "dust (default independent)", CHOICE_OF(SAMPLER, SAMPLERS), .says = "fine dust")
$(SETTING_ROW)/common/schema/settings.h: common/schema/settings.h Makefile
	@mkdir -p $(@D)
	$(call show,GEN)sed '/ SETTING(o, SWITCH, int, not_robust,/,/^$$/ s/^$$/    $(SETTING_ROWS)\n/; / SETTING(o, SWITCH, int, not_robust,/,/^$$/ s/))$$/)) \\/' $< >$@
COUNTER_ROW := X(hazy_rays, STEPS, "azulejo:hazyRays")
$(SETTING_ROW)/common/film/unit.h: common/film/unit.h Makefile
	@mkdir -p $(@D)
	$(call show,GEN)sed '/^#define WORK_COUNTERS/,/^$$/ s/^$$/    $(COUNTER_ROW)\n/; /^#define WORK_COUNTERS/,/^$$/ s/)$$/& \\/' $< >$@
$(SETTING_ROW)/protocol/azulejo.proto: protocol/azulejo.proto Makefile
	@mkdir -p $(@D)
	$(call show,GEN)sed 's/^  bool not_robust = 24;/&\n  float haze = 998;\n  uint32 dust = 999;/; s/^  uint64 leaked_rays = 5;/  uint64 hazy_rays = 998;\n&/' $< >$@
$(SETTING_ROW)/protocol/azulejo.pb-c.c $(SETTING_ROW)/protocol/azulejo.pb-c.h: $(SETTING_ROW)/protocol/azulejo.proto
	$(call show,GEN)cd $(SETTING_ROW) && $(PROTOC_C) --c_out=. protocol/azulejo.proto
$(SETTING_ROW)/protocol/azulejo.pb-c.o: $(SETTING_ROW)/protocol/azulejo.pb-c.c
	$(call show,CC)$(CC) -I$(SETTING_ROW) $(CPPFLAGS) $(filter-out $(WARNINGS),$(CFLAGS)) -MMD -MP -c -o $@ $<
$(SETTING_ROW)/obj/%.o: %.c | $(SETTING_ROW)/common/schema/settings.h $(SETTING_ROW)/common/film/unit.h $(SETTING_ROW)/protocol/azulejo.pb-c.h $(PROTO_HDR)
	@mkdir -p $(@D)
	$(call show,CC)$(CC) -I$(SETTING_ROW) $(CPPFLAGS) -DAZULEJO_VERSION='"$(VERSION)"' $(CFLAGS) -O1 -MMD -MP -c -o $@ $<
$(SETTING_ROW_TEST): $(SETTING_ROW_SRC:%.c=$(SETTING_ROW)/obj/%.o)
$(COUNTER_ROW_TEST): $(COUNTER_ROW_SRC:%.c=$(SETTING_ROW)/obj/%.o)
$(SETTING_ROW_TEST) $(COUNTER_ROW_TEST): $(BUILD)/%: $(SETTING_ROW)/obj/%.o $(SETTING_ROW_OBJ) $(LIB_SUPPORT) $(LIBRARIES)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $(filter %.o,$^) $(filter %.a,$^) -lcmocka $(LIBS_ALL)

# The same for a verb: a row of verbs.h, its message, and its function in tests/unit/schema; programs that have it.
VERB_ROW := $(ROW)/verb
VERB_ROW_SRC := tests/unit/schema/salute.c $(shell grep -rlE 'JOB_VERBS|\bVERB_[A-Z]|struct job_report' --include='*.c' client common coordinator web)
ifneq ($(WEB),1)
VERB_ROW_SRC := $(filter-out web/% coordinator/page/%,$(VERB_ROW_SRC))
endif
VERB_ROW_OBJ = $(patsubst %.c,$(VERB_ROW)/obj/%.o,$(filter $(1),$(VERB_ROW_SRC)))
VERB_ROW_COMMON := $(VERB_ROW)/obj/common/schema/verbs.o $(VERB_ROW)/protocol/azulejo.pb-c.o
VERB_ROW_PROGRAMS := $(PROGRAMS:$(BIN)/%=$(VERB_ROW)/bin/%)
VERB_ROW_TEXT := VERB(SALUTE, salute, OPERATE, verb_command, "Salute the job.", HELP("JOB... TEXT [OPTION]...", "salute jobs", "Salute jobs."), \
  .states = IN(QUEUED) | IN(PAUSED), .past = "saluted", .takes = VERB_TAKES_TEXT, .field = "words")
$(VERB_ROW)/common/schema/verbs.h: common/schema/verbs.h Makefile
	@mkdir -p $(@D)
	$(call show,GEN)sed 's/^    VERB(RESUME, /    $(VERB_ROW_TEXT) \\\n&/' $< >$@
$(VERB_ROW)/protocol/azulejo.proto: protocol/azulejo.proto Makefile
	@mkdir -p $(@D)
	$(call show,GEN)sed 's/^    JobPause job_pause = .*/&\n    JobSalute job_salute = 999;/; s/^message JobPause .*/&\nmessage JobSalute { uint64 job = 1; string words = 2; }/' $< >$@
$(VERB_ROW)/protocol/azulejo.pb-c.c $(VERB_ROW)/protocol/azulejo.pb-c.h: $(VERB_ROW)/protocol/azulejo.proto
	$(call show,GEN)cd $(VERB_ROW) && $(PROTOC_C) --c_out=. protocol/azulejo.proto
$(VERB_ROW)/protocol/azulejo.pb-c.o: $(VERB_ROW)/protocol/azulejo.pb-c.c
	$(call show,CC)$(CC) -I$(VERB_ROW) $(CPPFLAGS) $(filter-out $(WARNINGS),$(CFLAGS)) -MMD -MP -c -o $@ $<
$(VERB_ROW)/obj/%.o: %.c | $(VERB_ROW)/common/schema/verbs.h $(VERB_ROW)/protocol/azulejo.pb-c.h $(PROTO_HDR)
	@mkdir -p $(@D)
	$(call show,CC)$(CC) -I$(VERB_ROW) $(CPPFLAGS) $(CFLAGS) -O1 -MMD -MP -c -o $@ $<
$(VERB_ROW)/bin/azulejo: $(call VERB_ROW_OBJ,client/%) $(VERB_ROW_COMMON) $(LIB_CLIENT) $(LIB_PROTOCOL) $(LIB_COMMON)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ $(LIBS_CLIENT) $(LIBS_PROTOCOL) $(LIBS_COMMON)
$(VERB_ROW)/bin/azulejo-coordinator: $(call object,coordinator/main.c) $(call VERB_ROW_OBJ,coordinator/% tests/%) $(VERB_ROW_COMMON) $(LIB_COORDINATOR) $(LIB_PROTOCOL) $(LIB_COMMON)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ $(LIBS_COORDINATOR) $(LIBS_PROTOCOL) $(LIBS_COMMON)
$(VERB_ROW)/bin/azulejo-web: $(call object,web/main.c) $(call VERB_ROW_OBJ,web/%) $(VERB_ROW_COMMON) $(LIB_WEB) $(LIB_PROTOCOL) $(LIB_COMMON)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ $(LIBS_WEB) $(LIBS_PROTOCOL) $(LIBS_COMMON)
$(VERB_ROW)/bin/azulejo-worker: $(BIN)/azulejo-worker
	@mkdir -p $(@D)
	@cp $< $@

# The kernel variants with worker/render/base/fault.h switched on; a unit test and a folder of programs
# with them. The archive's own variants are then not linked.
FAULTS := $(BUILD)/faults
FAULT_OBJ := $(patsubst $(BUILD)/%,$(FAULTS)/%,$(KERNEL_OBJ))
FAULT_TEST := $(FAULT_TEST_SRC:%.c=$(BUILD)/%)
FAULT_PROGRAMS := $(PROGRAMS:$(BIN)/%=$(FAULTS)/bin/%)
$(FAULT_OBJ): CPPFLAGS += -DAZULEJO_FAULTS
$(FAULT_OBJ): CFLAGS += -O1 -g1
$(FAULTS)/obj/worker/render/kernel/recording.o: CPPFLAGS += -DKERNEL_RECORDS=1
$(FAULT_OBJ): $(KERNEL_SRC) Makefile | $(PROTO_HDR)
	$(call kernel,$(patsubst $(basename $(@F))=%,%,$(filter $(basename $(@F))=%,$(KERNEL_ROWS))))
$(FAULT_TEST): $(BUILD)/%: $(BUILD)/obj/%.o $(FAULT_OBJ) $(LIB_SUPPORT) $(LIBRARIES)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ -lcmocka $(LIBS_ALL)
$(FAULTS)/bin/azulejo-worker: $(call object,worker/main.c) $(FAULT_OBJ) $(LIB_WORKER) $(LIB_RENDER) $(LIB_PROTOCOL) $(LIB_COMMON)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ $(LIBS_RENDER) $(LIBS_PROTOCOL) $(LIBS_COMMON)
$(FAULTS)/bin/%: $(BIN)/%
	@mkdir -p $(@D)
	@cp $< $@

# A kernel with one scene's effects only, exact/SET/NAME.o, in place of the row NAME (tests/bench/bench_effects.py).
$(BUILD)/exact/%.o: $(KERNEL_SRC) Makefile | $(PROTO_HDR)
	$(call kernel,$(notdir $(@D)))
$(BUILD)/exact/%_bench_render: $(BUILD)/exact/%.o $(BUILD)/obj/tests/bench/bench_render.o $(LIB_SUPPORT) $(LIBRARIES)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) -o $@ $^ $(LIBS_ALL)

# Every fuzz target also replays its corpus as an ordinary test.
$(BUILD)/tests/fuzz/%_replay: $(BUILD)/obj/tests/fuzz/%.o $(BUILD)/obj/tests/support/fuzz_replay.o $(LIB_SUPPORT) $(LIBRARIES)
	@mkdir -p $(@D)
	$(call show,LD)$(CC) $(LDFLAGS) $(TEST_LDFLAGS) -o $@ $^ $(LIBS_ALL) -lcmocka

# The manual pages: prose, and the option tables that the programs print.
MAN_PROGRAMS := $(patsubst docs/man/%.in,$(BUILD)/man/%,$(wildcard docs/man/*.in))
MAN_COMMANDS := $(filter-out $(MAN_PROGRAMS),$(patsubst %,$(BUILD)/man/azulejo-%.1,$(shell sed -n 's/^@command //p' docs/man/azulejo.1.in)))
MAN := $(MAN_PROGRAMS) $(MAN_COMMANDS)
$(MAN_PROGRAMS): $(BUILD)/man/%: docs/man/%.in scripts/man.py $(PROGRAMS)
	@mkdir -p $(@D)
	$(call show,MAN)scripts/man.py $(BIN) $< >$@
$(MAN_COMMANDS): $(BUILD)/man/azulejo-%.1: docs/man/azulejo.1.in scripts/man.py $(PROGRAMS)
	@mkdir -p $(@D)
	$(call show,MAN)scripts/man.py $(BIN) $< $* >$@

# ---- test ---------------------------------------------------------------------------------
$(BUILD)/%.so: %.c
	@mkdir -p $(@D)
	$(call show,LD)$(CC) -std=c17 -D_GNU_SOURCE -O1 -g $(WARNINGS) -fPIC -shared -o $@ $< -ldl

ifneq ($(DOUBLE),)
# The tests are of the float that users run; the double build is measured against it (make precision).
tests:
	@echo "make: the double build has no tests: use 'make precision'" >&2; exit 1
else
tests: all $(TESTS) $(ROW_TEST) $(SETTING_ROW_TEST) $(COUNTER_ROW_TEST) $(VERB_ROW_PROGRAMS) $(FAULT_TEST) $(FAULT_PROGRAMS) $(TOOLS) $(ODD_LIBRARIES) $(ODD_WORKERS) $(CLIENTS) $(FUZZ_REPLAY) $(MAN)
endif

test: tests layers circles fields words budget docs-check ## every test; the end says "N passed, N failed"
	@BUILD=$(BUILD) SANITIZE=$(SANITIZE) WEB=$(WEB) tests/run.sh

check: tests layers fields words budget ## what has changed since it last passed, the quickest first, and a few farms: about two minutes
	@BUILD=$(BUILD) SANITIZE=$(SANITIZE) WEB=$(WEB) tests/run.sh --changed

test-elsewhere: ## HEAD built and tested in an odd place: umask, names of folders, TMPDIR, time zone, language, date (20 minutes)
	@tests/elsewhere.sh $(if $(ONLY),'$(ONLY)')

steady: tests ## which tests of farms and pages waver on a busy machine: N rounds in random order (N=3, SEED=1, ONLY=PATTERN, LATE=database, sync or answer)
	@BUILD=$(BUILD) tests/steady.py --rounds $(or $(N),3) --seed $(or $(SEED),1) $(if $(LATE),--late $(LATE)) $(if $(ONLY),'$(ONLY)')

fault-loop: tests ## each call of worker and coordinator fails once, of every kind, until none is left (three quarters of an hour)
	@BUILD=$(BUILD) FAULT_LOOP=all python3 tests/farm/test_fault_loop.py

chaos: tests ## rounds of random disasters on a farm: lost jobs and other pixels (ROUNDS=500, SEED=1; some 10 s each)
	@BUILD=$(BUILD) python3 tests/farm/chaos.py --rounds $(or $(ROUNDS),500) --seed $(or $(SEED),1)

test-web: tests ## the page in a real Chromium; axe-core is fetched from npm (docs/WEB.md)
	@scripts/fetch-axe.sh || true
	@BUILD=$(BUILD) SANITIZE=$(SANITIZE) WEB=$(WEB) TEST_WEB=required tests/run.sh tests/web/

blender-addon: ## the add-on for Blender 3.4 to 4.x as out/azulejo-blender-VERSION.zip (docs/BLENDER.md)
	@deploy/blender/make_zip.py $(VERSION) out/azulejo-blender-$(VERSION).zip
	@echo out/azulejo-blender-$(VERSION).zip

test-blender: all ## the add-on in a Blender without a window (needs Debian's blender and python3-numpy)
	@BUILD=$(BUILD) tests/run.sh tests/blender/

check-asan: ## the tests under AddressSanitizer and UndefinedBehaviorSanitizer
	$(MAKE) SANITIZE=address,undefined test
check-tsan: ## the tests under ThreadSanitizer
	$(MAKE) SANITIZE=thread test

circles: all ## prove that no folders, and no more than three files, call each other in a loop
	@scripts/check-circles.py $(BUILD)

words: ## prove that the glossary of docs/ARCHITECTURE.md is true
	@scripts/check-words.py

fields: ## prove that each field of a job is written in one room of the coordinator
	@scripts/check-fields.py

budget: ## prove that folders and circles of includes stay within their limits (scripts/budget.txt)
	@scripts/check-budget.py

tables: all $(ROW_TEST) $(SETTING_ROW_TEST) $(COUNTER_ROW_TEST) $(VERB_ROW_PROGRAMS) ## prove that one row more of the tables of materials, settings, work counters and verbs needs no other edit
	@BUILD=$(BUILD) tests/run.sh 'test_(material|setting|counter)_row'
	@BUILD=$(BUILD) python3 -B tests/farm/test_verbs.py row

docs-check: all $(MAN) ## prove that the documents name only what exists: links, pictures, commands, options, figures
	@scripts/check-docs.py --bin $(BIN)
	@docs/images/make_gallery.py --check
	@python3 -B tests/numerics/mistakes.py --check

gallery: all ## make the pictures of docs/GALLERY.md again (an hour of one core; AZULEJO_DATA names the data)
	@docs/images/make_gallery.py

docs-html: ## the documents as web pages, in out/html (needs cmark-gfm)
	@scripts/docs-html.py

test-docs: tests ## run every command of the documents that can be run (10 minutes; make test runs the quick ones)
	@BUILD=$(BUILD) DOCS=all tests/run.sh tests/farm/test_docs

layers: ## prove the dependency rule of docs/ARCHITECTURE.md
	@scripts/check-layers.sh

numerics: ## prove that a test notices the loss of each safeguard (docs/NUMERICS.md)
	$(MAKE) SAFEGUARDS=1 tests
	@python3 -B tests/numerics/safeguards.py build/safeguards $(NUMERICS_ARGS)

mistakes: all tests ## make mistakes on purpose in a copy, one at a time, and prove that a test notices each (docs/NUMERICS.md; MISTAKES_ARGS="--only NAME,...")
	@[ -d build/mistakes/build ] || { mkdir -p build/mistakes && cp -a --parents build/release build/gen build/mistakes; }
	@python3 -B tests/numerics/mistakes.py build/mistakes $(MISTAKES_ARGS)

invariance: tests ## one scene written in many ways, and every scene with and without transformations, SPP samples a pixel (docs/NUMERICS.md; 256: 10 minutes)
	@BUILD=$(BUILD) python3 -B tests/statistics/invariance_table.py $(SPP)
	@$(BUILD)/tests/statistics/test_transforms
transforms: tests ## every scene, those of AZULEJO_DATA, and every two things in one place, said in other words (docs/NUMERICS.md)
	@$(BUILD)/tests/statistics/test_transforms --table $(TRANSFORM_ARGS)
	@$(BUILD)/tests/statistics/test_pairs --all

precision: ## float against double on hard scenes (docs/NUMERICS.md; PRECISION_ARGS=--quick: 1 minute)
	$(MAKE) all build/release/tests/bench/bench_render
	$(MAKE) DOUBLE=1 all build/double/tests/bench/bench_render
	@python3 -B tests/numerics/precision.py build/release build/double $(PRECISION_ARGS)

test-slurm: all ## preempt, cancel and time out deploy/slurm's workers (needs slurm-wlm and munge)
	@BUILD=$(BUILD) deploy/slurm/try.sh

lint: ## clang-tidy and cppcheck
	@scripts/lint.sh

new-lobe: ## start a lobe: its file, rows, tests and a row of the manual (NAME=x)
	@scripts/new-lobe.py "$(NAME)"

test-new: ## what new-lobe and new-tonemap make builds and passes (builds a copy of the tree: 5 minutes)
	@python3 -B tests/farm/test_new.py --build

new-tonemap: ## start a tone mapper: its file, row, test and section (NAME=x)
	@scripts/new-tonemap.sh "$(NAME)"

format: ## lay out the C code (needs clang-format 14; what is aligned by hand stays)
	@scripts/layout.py

layout: ## prove that the C code is laid out
	@scripts/layout.py --check

fuzz: ## build the fuzz targets with clang's libFuzzer and run each for FUZZ_SECONDS (60)
	@scripts/fuzz.sh $(FUZZ_SRC)

accuracy-unbiased: tests ## adaptive pictures have the mean of uniform ones (10 minutes)
	@BUILD=$(BUILD) tests/accuracy/unbiased.sh
accuracy-allocation: tests ## what giving samples to tiles saves (docs/ALLOCATION.md; 20 minutes)
	@BUILD=$(BUILD) tests/accuracy/allocation.sh
accuracy-time: tests ## is the time left right on real scenes (docs/ACCURACY.md; 2 minutes)
	@BUILD=$(BUILD) tests/accuracy/time_left.sh

bench: all tests ## the figures in docs/PERFORMANCE.md
	@BUILD=$(BUILD) tests/bench/run.sh
bench-effects: all $(BUILD)/tests/bench/bench_render ## what the effects that a scene lacks cost it (docs/EFFECTS.md; EFFECTS_ARGS=--instructions counts by callgrind)
	@BUILD=$(BUILD) python3 -B tests/bench/bench_effects.py $(EFFECTS_ARGS)
bench-efficiency: all $(BUILD)/tests/bench/bench_render ## squared error times CPU time against the last release's: BASE=FOLDER, built; EFFICIENCY_ARGS=--write (docs/PERFORMANCE.md)
	@BUILD=$(BUILD) python3 -B tests/bench/bench_efficiency.py "$(BASE)" $(EFFICIENCY_ARGS)
bench-denoise: $(BUILD)/tests/bench/bench_denoise ## what denoising a picture takes (docs/DENOISING.md)
	@$(BUILD)/tests/bench/bench_denoise
bench-preview: all ## how soon a picture can be recognised
	@BUILD=$(BUILD) python3 -B tests/bench/bench_preview.py
bench-scale: all $(BUILD)/tests/bench/bench_scale $(BUILD)/tests/bench/bench_echo ## the figures in docs/SCALE.md: many workers, a long queue
	@python3 -B tests/bench/bench_scale.py $(SCALE_ARGS)
bench-farm: all ## what a farm takes of real jobs beside the last release; fails beyond the limits: BASE=FOLDER, built (without: beside stored figures); FARM_ARGS="--pairs 5" (docs/SCALE.md)
	@python3 -B tests/bench/bench_scale.py --base "$(BASE)" $(FARM_ARGS) farm
bench-page: all $(BUILD)/tests/bench/bench_scale $(ODD_LIBRARIES) ## the page in Chromium: first paint, frames, what it costs the coordinator (docs/WEB.md)
	@BUILD=$(BUILD) python3 -B tests/bench/bench_page.py $(PAGE_ARGS)
	@BUILD=$(BUILD) python3 -B tests/bench/bench_page.py --faults
	@BUILD=$(BUILD) python3 -B tests/bench/bench_page_cost.py
studio-day: $(BUILD)/tests/bench/studio_day ## a simulated day in a studio: who waits how long (docs/OPERATIONS.md)
	@$(BUILD)/tests/bench/studio_day
bench-accuracy: all ## efficiency over another commit's: AGAINST=COMMIT
	@BUILD=$(BUILD) python3 -B tests/bench/bench_accuracy.py "$(AGAINST)"

accuracy: all tests ## docs/ACCURACY.md: do the figures of error hold? ACCURACY_ARGS=--quick for a glance
	@BUILD=$(BUILD) tests/accuracy/accuracy.py --cache $(BUILD)/accuracy $(ACCURACY_ARGS)
accuracy-targets: all ## docs/ACCURACY.md: are targets met? (15 minutes)
	@BUILD=$(BUILD) tests/accuracy/targets.py --write
accuracy-prices: all ## docs/ACCURACY.md: are prices on a farm right? (4 minutes)
	@BUILD=$(BUILD) tests/accuracy/prices.py --write
accuracy-fresh: all ## docs/ACCURACY.md: how old are figures at 1080p? (5 minutes)
	@BUILD=$(BUILD) tests/accuracy/fresh.py --write

# ---- use ----------------------------------------------------------------------------------
demo: ## install what is missing, build, render the Cornell box on two workers into out/
	@scripts/install-deps.sh
	@$(MAKE) --no-print-directory all
	@BUILD=$(BUILD) scripts/demo.sh $(DEMO_ARGS)

# Below share/, where the shells look.
BASH_COMPLETIONS := bash-completion/completions
ZSH_COMPLETIONS := zsh/site-functions
FISH_COMPLETIONS := fish/vendor_completions.d
ifneq ($(DOUBLE),)
install: all
	install -d $(DESTDIR)$(PREFIX)/bin
	install -m 755 $(BIN)/azulejo-worker $(DESTDIR)$(PREFIX)/bin/azulejo-worker-double
else
install: all $(MAN) ## into $(DESTDIR)$(PREFIX)
	install -d $(DESTDIR)$(PREFIX)/bin $(DESTDIR)$(PREFIX)/share/man/man1 $(DESTDIR)$(PREFIX)/share/azulejo/scenes/cornell
	install -m 755 $(PROGRAMS) $(DESTDIR)$(PREFIX)/bin
	install -m 644 $(MAN) $(DESTDIR)$(PREFIX)/share/man/man1
	install -m 644 scenes/cornell/*.md scenes/cornell/*.gltf $(DESTDIR)$(PREFIX)/share/azulejo/scenes/cornell
	install -d $(addprefix $(DESTDIR)$(PREFIX)/share/,$(BASH_COMPLETIONS) $(ZSH_COMPLETIONS) $(FISH_COMPLETIONS))
	set -e; for program in $(notdir $(PROGRAMS)); do \
	  $(BIN)/azulejo completion bash $$program >$(DESTDIR)$(PREFIX)/share/$(BASH_COMPLETIONS)/$$program; \
	  $(BIN)/azulejo completion zsh $$program >$(DESTDIR)$(PREFIX)/share/$(ZSH_COMPLETIONS)/_$$program; \
	  $(BIN)/azulejo completion fish $$program >$(DESTDIR)$(PREFIX)/share/$(FISH_COMPLETIONS)/$$program.fish; \
	done
endif
uninstall:
	rm -f $(DESTDIR)$(PREFIX)/bin/azulejo-worker-double
	rm -f $(addprefix $(DESTDIR)$(PREFIX)/bin/,$(notdir $(PROGRAMS)))
	rm -f $(patsubst $(BUILD)/man/%,$(DESTDIR)$(PREFIX)/share/man/man1/%,$(MAN))
	rm -rf $(DESTDIR)$(PREFIX)/share/azulejo
	rm -f $(foreach p,$(notdir $(PROGRAMS)),$(addprefix $(DESTDIR)$(PREFIX)/share/,$(BASH_COMPLETIONS)/$(p) $(ZSH_COMPLETIONS)/_$(p) $(FISH_COMPLETIONS)/$(p).fish))

dist: ## the last commit as out/azulejo-VERSION.tar.gz, the same bytes from every clone
	@scripts/dist.sh $(VERSION)

clean: ## remove everything that was built
	rm -rf build out

-include $(shell find $(BUILD)/obj $(BUILD)/row $(FAULTS)/obj -name '*.d' 2>/dev/null)
