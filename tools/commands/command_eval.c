// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs eval`: the quality of a stored model on the views of a data set, image by image.

#include <inttypes.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#include "cli/commands.h"
#include "cli/file_stems.h"
#include "processes/interrupt.h"
#include "cli/json_result.h"
#include "cli/json_output.h"
#include "arguments/model_argument.h"
#include "arguments/model_path.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "processes/rank_group.h"
#include "cli/reported_files.h"
#include "cli/standard_output.h"
#include "draw/colormap.h"
#include "draw/photo_guard.h"
#include "run/evaluate.h"
#include "run/exposure_file.h"
#include "run/rank_work.h"
#include "run/run_record.h"
#include "sparegs/rank_check.h"

static const char description[] =
    "Renders the views of SCENE from MODEL (a model file, or a run folder, whose latest iteration "
    "is used) and compares them with the photos. Both images are quantised to 8 bits. PSNR covers "
    "all pixels and channels; SSIM uses an 11 x 11 Gaussian window with zero padding; FLIP is the "
    "mean perceptual error at 67 pixels per degree, 0 to 1; sharpness is the Laplacian energy of "
    "the render over that of the photo, below 1 = blurred. Image folder, size, split, filter and "
    "background default to those of the run. Under mpirun or srun, the views are distributed over "
    "the processes.";

// What --json reports about the model.
typedef struct model_size {
    size_t gaussians, bytes;
} model_size;

typedef struct eval_values {
    int split; // index of the word; mapped to sgs_split below
    const char *save, *lpips, *run;
    int lpips_input; // sgs_lpips_input
} eval_values;

static const option eval_options[] = {
    {.name = "split",
     .kind = OPTION_CHOICE,
     .offset = offsetof(eval_values, split),
     .argument = "test|train|all",
     .initial = "test",
     .shown = "test, or all if no images are held out",
     .help = "images to evaluate"},
    {.name = "save",
     .kind = OPTION_FOLDER,
     .offset = offsetof(eval_values, save),
     .argument = "DIR",
     .shown = "none",
     .help = "write NAME.png (render), NAME_photo.png (photo) and NAME_flip.png (FLIP error "
             "map, magma colours) to DIR"},
    RUN_OPTION(eval_values),
    LPIPS_OPTIONS(eval_values),
};

static const sgs_split splits[] = {SGS_SPLIT_TEST, SGS_SPLIT_TRAIN, SGS_SPLIT_ALL};

// Writes the two images and the FLIP error map of a view.
static bool save_images(const char *folder, const char *stem, const view_images *images)
{
    sgs_image8 errors = {0};
    const struct {
        const char *suffix;
        const sgs_image8 *image;
    } files[] = {{"", &images->drawn}, {"_photo", &images->photo}, {"_flip", &errors}};
    bool saved =
        errors_colored(images->flip_map, images->photo.width, images->photo.height, &errors);
    if (!saved)
        fail_run("not enough memory for an error map of %d x %d", images->photo.width,
                 images->photo.height);
    for (size_t k = 0; k < sizeof files / sizeof *files && saved; ++k) {
        char *path = format_text("%s/%s%s.png", folder, stem, files[k].suffix);
        saved = make_folder_of(path);
        if (saved && sgs_png_write(path, files[k].image)) {
            fail_library();
            saved = false;
        }
        free(path);
    }
    free(errors.pixels);
    return saved;
}

static void print_row(const evaluator *evaluation, const char *name, const view_score *score)
{
    char sharpness[SHARPNESS_TEXT];
    printf("%-32s %8.3f dB  %.5f  %.5f  %s", name, score->psnr, score->ssim, score->flip,
           sharpness_format(sharpness, score->sharpness, 9, 4));
    if (evaluation->lpips)
        printf("  %.5f", score->lpips);
    putchar('\n');
}

// Where the images of each view are saved.
typedef struct image_folder {
    const char *path;
    char **stems; // [views]
} image_folder;

static bool save_view(void *context, size_t view, const view_images *images)
{
    const image_folder *folder = context;
    return save_images(folder->path, folder->stems[view], images);
}

// Adds one view to the table or the JSON list.
static void add_row(const evaluator *evaluation, const sgs_view *view, const view_score *score,
                    json_t *list, split_score *sum)
{
    split_score_add(sum, view, score);
    if (list) {
        json_t *entry = json_object();
        json_object_set_new(entry, "name", json_text(view->name));
        view_score_add_json(entry, score);
        json_object_set_new(entry, "identical", json_boolean(isinf(score->psnr)));
        json_array_append_new(list, entry);
    } else {
        print_row(evaluation, view->name, score);
        stdout_flush();
    }
}

// Scores one view, saves its images if a folder is given, and adds its row.
static bool evaluate_one(evaluator *evaluation, size_t v, image_folder *folder, json_t *list,
                         split_score *sum)
{
    const sgs_view *view = &evaluation->scene->views[v];
    view_score score;
    view_images images = {0};
    bool done = evaluate_view(evaluation, view, &score, folder ? &images : NULL);
    if (done && folder)
        done = save_view(folder, v, &images);
    view_images_free(&images);
    if (done)
        add_row(evaluation, view, &score, list, sum);
    return done;
}

// The rows of all views, which the ranks share.
static bool evaluate_on_ranks(evaluator *evaluation, sgs_split split, image_folder *folder,
                              json_t *list, split_score *sum)
{
    const size_t count = evaluation->scene->view_count;
    rank_score *scores = calloc(count + 1, sizeof *scores);
    bool done = scores != NULL;
    if (!done)
        fail_run("not enough memory for the scores of %zu views", count);
    done = group_all(done) && evaluate_views(evaluation, split, SIZE_MAX, NULL,
                                             folder ? save_view : NULL, folder, scores);
    group_stop_requested(); // all ranks then end alike
    for (size_t v = 0; v < count && done; ++v)
        if (scores[v].is_scored)
            add_row(evaluation, &evaluation->scene->views[v], &scores[v].score, list, sum);
    free(scores);
    return done;
}

// The images that are evaluated.
typedef struct image_choice {
    sgs_split split;
    size_t count, trained; // trained: those that the model was trained on
} image_choice;

// Which images the model was trained on is known from its run, else taken from the split.
static image_choice choose_images(const command_line *line, const model_path *located,
                                  const sgs_scene *scene, sgs_split split)
{
    image_choice images = {.split = split, .count = scene_split_count(scene, split)};
    const ptrdiff_t trained =
        located->run ? run_record_trained(located->run, located->config, scene, split) : -1;
    if (trained >= 0 && split == SGS_SPLIT_ALL && option_given(line, "split"))
        warn_idle(line, "eval|test-every|test-images",
                  "with --split all on a run, which records the held-out images");
    images.trained = trained >= 0              ? (size_t)trained
                     : split == SGS_SPLIT_TEST ? 0
                                               : scene_split_count(scene, SGS_SPLIT_TRAIN);
    if (split == SGS_SPLIT_TEST && images.trained)
        print_warning("%s was trained on %zu of the %zu images; their scores are not those of "
                      "held-out images",
                      located->run, images.trained, images.count);
    return images;
}

static void print_means(const evaluator *evaluation, const image_choice *images,
                        const split_score *mean, const model_size *size)
{
    const size_t trained = images->trained;
    char *kind =
        !trained && images->split == SGS_SPLIT_TEST ? format_text("held out")
        : images->split == SGS_SPLIT_TRAIN && trained == images->count
            ? format_text("training images")
            : format_text("%zu training images, %zu held out", trained, images->count - trained);
    char sharpness[SHARPNESS_TEXT];
    print_row(evaluation, "mean", &mean->mean);
    printf("%zu primitives, %.3g s per image\n", size->gaussians, mean->mean.seconds);
    printf("PSNR %.2f dB, SSIM %.4f, FLIP %.4f, sharpness %s", mean->mean.psnr, mean->mean.ssim,
           mean->mean.flip, sharpness_format(sharpness, mean->mean.sharpness, 0, 3));
    if (evaluation->lpips)
        printf(", LPIPS %.4f (%s)", mean->mean.lpips, sgs_lpips_network(evaluation->lpips));
    printf(" over %zu images (%s)\n", mean->images, kind);
    if (mean->identical)
        printf("%zu of them identical to the photo: PSNR is infinite and counts as %g dB in "
               "the mean\n",
               mean->identical, IDENTICAL_PSNR);
    free(kind);
}

static bool print_scores_json(const evaluator *evaluation, const image_choice *images,
                              const split_score *mean, const model_size *size, json_t *list)
{
    static const char *const names[] = {
        [SGS_SPLIT_TEST] = "test", [SGS_SPLIT_TRAIN] = "train", [SGS_SPLIT_ALL] = "all"};
    json_t *root = json_result_new();
    json_object_set_new(root, "gaussians", json_integer((json_int_t)size->gaussians));
    json_object_set_new(root, "bytes", json_integer((json_int_t)size->bytes));
    json_object_set_new(root, "split", json_string(names[images->split]));
    json_object_set_new(root, "training_images", json_integer((json_int_t)images->trained));
    if (evaluation->lpips) {
        json_object_set_new(root, "lpips_network",
                            json_string(sgs_lpips_network(evaluation->lpips)));
        json_object_set_new(
            root, "lpips_input",
            json_string(evaluation->lpips_input == SGS_LPIPS_SIGNED ? "signed" : "unit"));
    }
    json_object_set_new(root, "images", list);
    json_t *means = json_object();
    view_score_add_json(means, &mean->mean);
    json_object_set_new(means, "identical", json_integer((json_int_t)mean->identical));
    json_object_set_new(root, "mean", means);
    json_object_set_new(root, "seconds_per_image", json_number(mean->mean.seconds));
    return print_json(root);
}

static bool evaluate_all(evaluator *evaluation, const image_choice *images, const char *save,
                         const model_size *size, bool json)
{
    const sgs_split split = images->split;
    json_t *list = json ? json_array() : NULL;
    split_score sum = {0};
    const sgs_view *views = evaluation->scene->views;
    const size_t count = evaluation->scene->view_count;
    char **stems = save ? file_stems(&views->name, sizeof *views, count) : NULL;
    bool ready = !save || (stems && photo_guard_admits_saved(evaluation->scene, save, stems));
    ready = ready && (!save || (make_folder(save) && check_writable(save)));
    if (!group_all(ready)) {
        file_stems_free(stems, count);
        json_decref(list);
        return false;
    }
    bool done = true;
    if (!json)
        printf("%-32s %11s  %-7s  %-7s  %s%s\n", "image", "PSNR", "SSIM", "FLIP", "sharpness",
               evaluation->lpips ? "  LPIPS" : "");
    image_folder folder = {save, stems};
    if (group_ranks())
        done = evaluate_on_ranks(evaluation, split, save ? &folder : NULL, list, &sum);
    for (size_t v = 0; v < count && done && !interrupt_signal() && !group_ranks(); ++v)
        if (view_in_split(&views[v], split)) {
            evaluate_prefetch(evaluation->scene, split, v + 1);
            done = evaluate_one(evaluation, v, save ? &folder : NULL, list, &sum);
        }
    file_stems_free(stems, count);
    if (!done || interrupt_signal()) {
        if (json_array_size(list)) { // the scores so far
            json_t *root = json_result_new();
            json_object_set(root, "images", list);
            json_result_set(root);
        }
        json_decref(list);
        return done;
    }
    if (!sum.images) {
        json_decref(list);
        fail_run("%s: no image of this split has a valid pixel; use --masks none to ignore masks",
                 evaluation->scene->path);
        return false;
    }
    split_score_finish(&sum);
    if (json)
        return print_scores_json(evaluation, images, &sum, size, list);
    print_means(evaluation, images, &sum, size);
    return true;
}

typedef struct split_views {
    const sgs_scene *scene;
    sgs_split split;
    const drawing_values *drawing;
    const json_t *exposures; // or NULL
    const char *weights;     // file of LPIPS, or NULL
} split_views;

static bool describe_views(FILE *out, const void *context)
{
    const split_views *views = context;
    const sgs_scene *scene = views->scene;
    rank_work_write_drawing(out, views->drawing);
    if (!rank_work_write_json(out, "exposure", views->exposures))
        return false;
    if (views->weights)
        fprintf(out, "content of %s: %016" PRIx64 "\n", views->weights,
                sgs_rank_file_digest(views->weights));
    // Scores are gathered by index in the scene.
    fprintf(out, "number of images: %zu\nimages in the split: %zu\n", scene->view_count,
            scene_split_count(scene, views->split));
    for (size_t v = 0; v < scene->view_count; ++v) {
        const sgs_view *view = &scene->views[v];
        const sgs_photo *photo;
        if (!view_in_split(view, views->split))
            continue;
        if (sgs_scene_photo(scene, v, &photo)) {
            fail_library();
            return false;
        }
        fprintf(out, "index of %s: %zu\ncamera of %s: %016" PRIx64 "\nphoto %s: %016" PRIx64 "\n",
                view->name, v, view->name, sgs_rank_camera_digest(&view->camera, &view->pose),
                view->name, sgs_rank_photo_digest(photo));
    }
    return true;
}

// Without --split, images recorded as held out are compared. False after printing the error if none
// of them is there; the training images would take their place.
static bool held_out_found(const scene_values *data, const sgs_scene *scene)
{
    const size_t recorded = json_array_size(data->held_out);
    const size_t found = recorded ? scene_split_count(scene, SGS_SPLIT_TEST) : 0;
    if (recorded && !found)
        fail_run("%s: contains none of the %zu held-out images of the run, such as '%s'; restore "
                 "them, or select other images with --split",
                 scene->path, recorded, json_string_value(json_array_get(data->held_out, 0)));
    else if (found < recorded)
        print_warning("%s: contains %zu of the %zu held-out images of the run", scene->path, found,
                      recorded);
    return !recorded || found;
}

static int evaluate_model(const command_line *line, const model_path *located,
                          const json_t *exposures, const sgs_lpips *lpips, const sgs_scene *scene,
                          drawing_values *drawing, const eval_values *values, bool json)
{
    sgs_split split = splits[values->split];
    if (!option_given(line, "split") && !scene_split_count(scene, split))
        split = SGS_SPLIT_ALL;
    if (!scene_split_count(scene, split))
        return fail_run("%s: no images in this split; hold images out with --eval, --test-every or "
                        "--test-images",
                        scene->path);
    sgs_gaussians *model = NULL;
    sgs_model_info info;
    if (!model_read_info(located, drawing, &model, &info))
        return EXIT_FAILED;
    evaluator evaluation = {0};
    const model_size size = {model->count, info.file_bytes};
    const split_views views = {scene, split, drawing, exposures, values->lpips};
    bool done = rank_work_agrees(&(rank_work){line, model, describe_views, &views}) &&
                evaluator_open(&evaluation, model, scene, drawing);
    evaluation.exposures = exposures;
    evaluation.lpips = lpips;
    evaluation.lpips_input = (sgs_lpips_input)values->lpips_input;
    const image_choice images = choose_images(line, located, scene, split);
    done = done && evaluate_all(&evaluation, &images, values->save, &size, json);
    evaluator_close(&evaluation);
    sgs_gaussians_destroy(model);
    return done ? interrupt_status() : EXIT_FAILED;
}

int command_eval(int argc, char **argv)
{
    command_call call;
    scene_values data;
    drawing_values drawing;
    eval_values values = {0};
    const command_spec spec = {.name = "eval",
                               .synopsis = "MODEL SCENE [options]",
                               .description = description,
                               .operand_minimum = 2,
                               .operand_maximum = 2,
                               .title = "Evaluation",
                               .options = eval_options,
                               .option_count = sizeof eval_options / sizeof *eval_options,
                               .values = &values,
                               .scene = &data,
                               .drawing = &drawing};
    int status = command_begin(&spec, argc, argv, &call);
    if (status >= 0)
        return status;
    interrupt_watch();
    sgs_lpips *lpips = NULL;
    if (values.lpips && sgs_lpips_read(values.lpips, &lpips))
        return fail_library();
    model_path located;
    sgs_scene *scene = NULL;
    status = EXIT_FAILED;
    if (model_locate_of_run(call.line.operands[0], values.run, &located)) {
        status = model_scene_resolve(&data, &call.line, &located);
        if (status < 0)
            scene = scene_open(call.line.operands[1], &data, true);
        if (status < 0 && scene) {
            scene_warn_idle(scene, &data, &call.line);
            if (located.run)
                run_record_check_scene(located.run, scene);
            drawing_resolve(&drawing, &call.line, located.config, &data, scene);
            json_t *exposures = NULL;
            if ((option_given(&call.line, "split") || held_out_found(&data, scene)) &&
                exposure_of_model(&located, scene, &exposures))
                status = evaluate_model(&call.line, &located, exposures, lpips, scene, &drawing,
                                        &values, call.common.json);
            json_decref(exposures);
        }
    }
    sgs_scene_destroy(scene);
    sgs_lpips_destroy(lpips);
    model_path_free(&located);
    return status < 0 ? EXIT_FAILED : status;
}
