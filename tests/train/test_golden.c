// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Golden numbers: the losses of the first ten iterations and the model's hash after a short
// training of the bundled scene, for each pipeline and instruction set, must equal
// tests/data/golden.json. Detects changes of the whole program, also by a compiler, which tests
// that compare the program with itself miss. To accept a change, run with SPAREGS_UPDATE_GOLDEN=1,
// commit the file and give the reason in the message.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <jansson.h>

#include "base/core.h"
#include "sparegs/runtime.h"
#include "sparegs/trainer.h"

#define GOLDEN SGSI_TEST_DATA "/golden.json"

enum { ITERATIONS = 150, LOSSES = 10 };

typedef struct result {
    double losses[LOSSES];
    char hash[17];
    size_t gaussians;
    int updates; // structural updates
} result;

static const char *const pipeline_names[SGS_PIPELINE_COUNT] = {
    [SGS_PIPELINE_3DGS] = "3dgs",     [SGS_PIPELINE_MIP] = "mip",
    [SGS_PIPELINE_TAMING] = "taming", [SGS_PIPELINE_DASH] = "dash",
    [SGS_PIPELINE_FASTGS] = "fastgs", [SGS_PIPELINE_MCMC] = "mcmc",
};

static sgs_scene *scene;
static json_t *golden;

static int load(void **state)
{
    (void)state;
    golden = json_load_file(GOLDEN, 0, NULL);
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 4;
    return !golden || sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene) != SGS_STATUS_OK;
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    json_decref(golden);
    return 0;
}

static result train(sgs_pipeline pipeline)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = ITERATIONS;
    options.pipeline = pipeline;
    options.filter = pipeline == SGS_PIPELINE_MIP ? SGS_FILTER_MIP : SGS_FILTER_3DGS;
    options.spare = SGS_SPARE_BMD | SGS_SPARE_RAP;
    sgs_trainer *trainer;
    if (sgs_trainer_create(scene, &options, &trainer))
        fail_msg("%s", sgs_last_error());
    result out = {0};
    sgs_step_info info;
    for (int i = 0; i < ITERATIONS; ++i) {
        if (sgs_trainer_step(trainer, &info))
            fail_msg("%s", sgs_last_error());
        if (i < LOSSES)
            out.losses[i] = info.loss;
        out.updates += info.structural;
    }
    sgs_gaussians_hash(sgs_trainer_model(trainer), out.hash);
    out.gaussians = info.gaussians;
    sgs_trainer_destroy(trainer);
    return out;
}

static void update(const char *set, const char *pipeline, const result *r)
{
    json_t *losses = json_array();
    for (int i = 0; i < LOSSES; ++i)
        json_array_append_new(losses, json_real(r->losses[i]));
    json_t *entry = json_pack("{s:s, s:I, s:o}", "model_hash", r->hash, "gaussians",
                              (json_int_t)r->gaussians, "losses", losses);
    json_t *training = json_object_get(golden, "training");
    json_t *of_set = json_object_get(training, set);
    if (!of_set) {
        of_set = json_object();
        json_object_set_new(training, set, of_set);
    }
    assert_int_equal(json_object_set_new(of_set, pipeline, entry), 0);
    assert_int_equal(json_dump_file(golden, GOLDEN, JSON_INDENT(1) | JSON_SORT_KEYS), 0);
}

static void compare(const char *set, const char *pipeline, const result *r)
{
    const json_t *entry =
        json_object_get(json_object_get(json_object_get(golden, "training"), set), pipeline);
    if (!entry)
        fail_msg("%s has no numbers of %s for %s", GOLDEN, pipeline, set);
    const json_t *losses = json_object_get(entry, "losses");
    assert_int_equal(json_array_size(losses), LOSSES);
    for (size_t i = 0; i < LOSSES; ++i) {
        const double expected = json_real_value(json_array_get(losses, i));
        if (!(r->losses[i] == expected))
            fail_msg("%s, %s: loss of iteration %zu is %.17g, expected %.17g", pipeline, set, i + 1,
                     r->losses[i], expected);
    }
    if (strcmp(r->hash, json_string_value(json_object_get(entry, "model_hash"))) != 0)
        fail_msg("%s, %s: model_hash is %s with %zu primitives, expected %s with %d", pipeline, set,
                 r->hash, r->gaussians, json_string_value(json_object_get(entry, "model_hash")),
                 (int)json_integer_value(json_object_get(entry, "gaussians")));
}

// The best instruction set has all pipelines. Others have those that together call every kernel:
// with both pixel filters, absolute gradients, scores of views, and the noise of relocated
// primitives; and all if SPAREGS_LONG is set.
static bool has_pipeline(sgs_isa isa, sgs_isa best, int pipeline)
{
    return isa == best || (pipeline != SGS_PIPELINE_3DGS && pipeline != SGS_PIPELINE_DASH) ||
           getenv("SPAREGS_LONG") || getenv("SPAREGS_UPDATE_GOLDEN");
}

static void training_gives_the_golden_numbers(void **state)
{
    (void)state;
    const sgs_isa best = sgs_isa_get();
    int sets = 0;
    for (int isa = 0; isa <= SGS_ISA_AVX512; ++isa) {
        if (!sgs_isa_supported((sgs_isa)isa))
            continue;
        sgs_isa_set((sgs_isa)isa);
        ++sets;
        const char *set = isa == SGS_ISA_BASELINE ? "baseline" : "avx2 and avx512";
        for (int p = 0; p < SGS_PIPELINE_COUNT; ++p) {
            if (!has_pipeline((sgs_isa)isa, best, p))
                continue;
            const result r = train((sgs_pipeline)p);
            assert_true(r.updates > 0);
            if (getenv("SPAREGS_UPDATE_GOLDEN"))
                update(set, pipeline_names[p], &r);
            else
                compare(set, pipeline_names[p], &r);
        }
    }
    sgs_isa_set(best);
    assert_true(sets >= 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(training_gives_the_golden_numbers)};
    return cmocka_run_group_tests(tests, load, unload);
}
