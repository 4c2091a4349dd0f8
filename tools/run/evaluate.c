// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Evaluation. A photo with alpha is composited over the background with the same quantisation
// as the render. Masked pixels and pixels without a ray are excluded. Linear colours are
// display-encoded first and clipped at the white point, so that scores refer to the displayed
// image.

#include "run/evaluate.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/json_output.h"
#include "cli/progress.h"
#include "processes/interrupt.h"
#include "processes/rank_group.h"
#include "run/display_planes.h"
#include "run/exposure_file.h"

static evaluator without_renderer(const sgs_scene *scene, const drawing_values *drawing)
{
    evaluator made = {.scene = scene, .render = drawing_render_options(drawing)};
    memcpy(made.background, drawing->background, sizeof made.background);
    return made;
}

bool evaluator_open(evaluator *evaluation, const sgs_gaussians *model, const sgs_scene *scene,
                    const drawing_values *drawing)
{
    *evaluation = without_renderer(scene, drawing);
    if (sgs_renderer_create(model, &evaluation->renderer)) {
        fail_library();
        return false;
    }
    return true;
}

bool evaluator_open_shared(evaluator *evaluation, const char *path, const sgs_scene *scene,
                           const drawing_values *drawing)
{
    *evaluation = without_renderer(scene, drawing);
    if (!sgs_rank_renderer_create(group_ranks(), scene, path, &evaluation->render,
                                  &evaluation->rank_renderer))
        return true;
    fail_library();
    return false;
}

void evaluator_close(evaluator *evaluation)
{
    sgs_renderer_destroy(evaluation->renderer);
    sgs_rank_renderer_destroy(evaluation->rank_renderer);
    sgs_frame_free(&evaluation->frame);
    evaluation->renderer = NULL;
    evaluation->rank_renderer = NULL;
}

bool evaluate_lpips(const char *path, const sgs_scene *scene, sgs_lpips **lpips)
{
    if (!path)
        return true;
    if (sgs_lpips_read(path, lpips)) {
        fail_library();
        return false;
    }
    const int smallest = sgs_lpips_min_size(*lpips);
    for (size_t v = 0; v < scene->view_count; ++v) {
        const sgs_view *view = &scene->views[v];
        if (view->camera.width >= smallest && view->camera.height >= smallest)
            continue;
        fail_run("%s: %s has %d x %d pixels; --lpips with the network %s requires at least %d x %d",
                 scene->path, view->name, view->camera.width, view->camera.height,
                 sgs_lpips_network(*lpips), smallest, smallest);
        return false;
    }
    return true;
}

// Makes the frame that of a view; renderings fill all of it.
static sgs_status prepare_frame(evaluator *evaluation, const sgs_view *view)
{
    sgs_frame *frame = &evaluation->frame;
    if (frame->width == view->camera.width && frame->height == view->camera.height)
        return SGS_STATUS_OK;
    sgs_frame_free(frame);
    return sgs_frame_create_with(view->camera.width, view->camera.height, 0, frame); // no AOVs
}

static bool draw(evaluator *evaluation, const sgs_view *view)
{
    if (!prepare_frame(evaluation, view) &&
        !sgs_renderer_render(evaluation->renderer, &view->camera, &view->pose, &evaluation->render,
                             &evaluation->frame))
        return true;
    fail_library();
    return false;
}

// The images that are compared. False after printing the error.
static bool quantise(const evaluator *evaluation, const sgs_photo *photo, view_images *compared)
{
    const sgs_frame *frame = &evaluation->frame;
    const sgs_space space = evaluation->scene->space;
    if (!sgs_image8_from_photo(photo, evaluation->background, space, &compared->photo) &&
        !sgs_image8_from_render((const float *const *)frame->color, NULL, NULL, space, frame->width,
                                frame->height, &compared->drawn))
        return true;
    fail_library();
    return false;
}

// The map of a photo without a recorded one.
static bool fit_exposure(const sgs_frame *frame, const float *transmittance, const sgs_photo *photo,
                         const float background[3], double map[12])
{
    const size_t pixels = (size_t)photo->width * (size_t)photo->height;
    float *planes = malloc(3 * pixels * sizeof *planes);
    if (!planes) {
        fail_run("not enough memory to compare a photo of %d x %d", photo->width, photo->height);
        return false;
    }
    sgs_photo_flatten(photo, background, planes);
    float *const color[3] = {planes, planes + pixels, planes + 2 * pixels};
    exposure_fit(frame->color, transmittance, color, photo->valid_mask, frame->width, frame->height,
                 map);
    free(planes);
    return true;
}

// Applies the exposure of the photo to the render and adds the background: after the map if
// the photo has an alpha channel, as in training. *half receives the mask of pixels to
// evaluate if the other half was used to fit the exposure.
static bool expose(const evaluator *evaluation, const sgs_view *view, const sgs_photo *photo,
                   sgs_frame *frame, uint16_t **half)
{
    static const float black[3] = {0};
    double map[12];
    const bool alpha = photo->channels == 4;
    const float *transmittance = alpha ? frame->transmittance : NULL;
    if (!alpha || !evaluation->exposures)
        frame_add_background(frame, evaluation->background);
    if (!evaluation->exposures)
        return true;
    if (!exposure_find(evaluation->exposures, view->name, map)) {
        if (!fit_exposure(frame, transmittance, photo, alpha ? black : evaluation->background, map))
            return false;
        *half = exposure_right_half(photo->valid_mask, frame->width, frame->height);
        if (!*half) {
            fail_run("not enough memory to compare a photo of %d x %d", frame->width,
                     frame->height);
            return false;
        }
    }
    exposure_apply(frame->color, transmittance, (size_t)frame->width * (size_t)frame->height, map);
    if (alpha)
        frame_add_background(frame, evaluation->background);
    return true;
}

void view_images_free(view_images *images)
{
    sgs_image8_free(&images->drawn);
    sgs_image8_free(&images->photo);
    free(images->flip_map);
    *images = (view_images){0};
}

// Computes the figures, and the FLIP map if `mapped`.
static bool compare(const evaluator *evaluation, view_images *images, const uint16_t *valid_mask,
                    bool mapped, view_score *score)
{
    const sgs_image8 *drawn = &images->drawn, *photo = &images->photo;
    if (mapped)
        images->flip_map =
            malloc((size_t)photo->width * (size_t)photo->height * sizeof *images->flip_map);
    *score = (view_score){.psnr = sgs_psnr_masked(drawn, photo, valid_mask),
                          .ssim = sgs_ssim_masked(drawn, photo, valid_mask),
                          .sharpness = sgs_sharpness(drawn, photo, valid_mask),
                          .lpips = NAN};
    const bool lacks_memory = isnan(score->ssim) && !isnan(score->psnr);
    if ((mapped && !images->flip_map) || lacks_memory) {
        fail_run("not enough memory to compare a photo of %d x %d", photo->width, photo->height);
        return false;
    }
    if (!sgs_flip(photo, drawn, valid_mask, SGS_FLIP_PIXELS_PER_DEGREE, images->flip_map,
                  &score->flip) &&
        (!evaluation->lpips || !sgs_lpips_distance(evaluation->lpips, evaluation->lpips_input,
                                                   drawn, photo, valid_mask, &score->lpips)))
        return true;
    fail_library();
    return false;
}

// Scores the frame without background, which it changes.
static bool score_frame(evaluator *evaluation, const sgs_view *view, view_score *score,
                        view_images *images)
{
    sgs_frame *frame = &evaluation->frame;
    view_images compared = {0};
    const sgs_photo *source = NULL;
    uint16_t *half = NULL;
    bool done =
        !sgs_scene_photo(evaluation->scene, (size_t)(view - evaluation->scene->views), &source);
    if (!done)
        fail_library();
    done = done && expose(evaluation, view, source, frame, &half) &&
           quantise(evaluation, source, &compared) &&
           compare(evaluation, &compared, half ? half : source->valid_mask, images != NULL, score);
    free(half);
    if (!done || !images)
        view_images_free(&compared);
    if (images)
        *images = compared;
    return done;
}

bool evaluate_view(evaluator *evaluation, const sgs_view *view, view_score *score,
                   view_images *images)
{
    const double start = clock_seconds();
    const bool drawn = draw(evaluation, view);
    const double seconds = clock_seconds() - start;
    const bool done = drawn && score_frame(evaluation, view, score, images);
    score->seconds = seconds;
    return done;
}

void split_score_add(split_score *sum, const sgs_view *view, const view_score *score)
{
    if (isnan(score->psnr)) {
        print_warning("%s: mask excludes every pixel; the image is excluded from the mean",
                      view->name);
        return;
    }
    ++sum->images;
    sum->identical += isinf(score->psnr) != 0;
    sum->mean.psnr += fmin(score->psnr, IDENTICAL_PSNR);
    sum->mean.ssim += score->ssim;
    sum->mean.flip += score->flip;
    sum->mean.lpips += score->lpips;
    sum->mean.seconds += score->seconds;
    if (!isnan(score->sharpness)) {
        ++sum->sharp_images;
        sum->mean.sharpness += score->sharpness;
    }
}

void split_score_finish(split_score *sum)
{
    const double images = (double)sum->images;
    sum->mean =
        (view_score){sum->mean.psnr / images,  sum->mean.ssim / images,
                     sum->mean.flip / images,  sum->mean.sharpness / (double)sum->sharp_images,
                     sum->mean.lpips / images, sum->mean.seconds / images};
}

void evaluate_prefetch(const sgs_scene *scene, sgs_split split, size_t next)
{
    size_t left = sgs_scene_prefetch_count(scene);
    for (size_t v = next; v < scene->view_count && left > 0; ++v)
        if (view_in_split(&scene->views[v], split)) {
            sgs_scene_prefetch(scene, v);
            --left;
        }
}

// Indices of the views to score.
typedef struct view_choice {
    size_t *views;
    size_t count;
} view_choice;

// At most `most` views of the split, evenly spaced. False after printing the error.
static bool choose_views(const sgs_scene *scene, sgs_split split, size_t most, view_choice *choice)
{
    *choice = (view_choice){.views = malloc((scene->view_count + 1) * sizeof *choice->views)};
    if (!choice->views) {
        fail_run("not enough memory for %zu views", scene->view_count);
        return false;
    }
    for (size_t v = 0; v < scene->view_count; ++v)
        if (view_in_split(&scene->views[v], split))
            choice->views[choice->count++] = v;
    const size_t all = choice->count;
    choice->count = all < most ? all : most;
    for (size_t k = 0; k < choice->count; ++k)
        choice->views[k] = choice->views[k * all / choice->count];
    return true;
}

// Decodes the next photos of this rank in advance: every one from the k-th on, in steps of the
// number of ranks.
static void prefetch_photos(const sgs_scene *scene, const view_choice *choice, size_t k)
{
    const size_t ahead = sgs_scene_prefetch_count(scene);
    for (size_t i = 0; i < ahead && k < choice->count; ++i, k += (size_t)group_count())
        sgs_scene_prefetch(scene, choice->views[k]);
}

// Scores the views of this rank, with a model that every rank has.
static bool score_own(evaluator *evaluation, const view_choice *choice, const char *label,
                      evaluate_save save, void *context, rank_score *scores)
{
    const size_t count = (size_t)group_count();
    bool done = true;
    for (size_t i = 0; i < choice->count; ++i) {
        if (i % count == 0 && !group_continues(i / count, GROUP_ROUNDS, done))
            break;
        if (i % count != (size_t)sgs_ranks_rank(group_ranks()) || !done || interrupt_signal())
            continue;
        if (label)
            progress_count(label, i, choice->count);
        prefetch_photos(evaluation->scene, choice, i + count);
        const size_t v = choice->views[i];
        view_images images = {0};
        done = evaluate_view(evaluation, &evaluation->scene->views[v], &scores[v].score,
                             save ? &images : NULL);
        done = done && (!save || save(context, v, &images));
        view_images_free(&images);
        scores[v].is_scored = done;
    }
    return done;
}

// All ranks draw each of `count` views; rank i scores view i. Collective.
static bool score_round(evaluator *evaluation, const size_t *views, size_t count,
                        rank_score *scores)
{
    const size_t rank = (size_t)sgs_ranks_rank(group_ranks());
    const sgs_view *own = rank < count ? &evaluation->scene->views[views[rank]] : NULL;
    sgs_status status = own ? prepare_frame(evaluation, own) : SGS_STATUS_OK;
    const double start = clock_seconds();
    for (size_t i = 0; i < count && (!status || !i); ++i)
        status = sgs_rank_renderer_render(evaluation->rank_renderer, status, views[i], (int)i,
                                          &evaluation->frame);
    const double seconds = (clock_seconds() - start) / (double)count;
    if (status)
        fail_library(); // that of all ranks
    else if (own) {
        scores[views[rank]].is_scored =
            score_frame(evaluation, own, &scores[views[rank]].score, NULL);
        scores[views[rank]].score.seconds = seconds;
    }
    return group_all(!status && (!own || scores[views[rank]].is_scored));
}

// Scores views with a model that the ranks share. Collective.
static bool score_together(evaluator *evaluation, const view_choice *choice, const char *label,
                           rank_score *scores)
{
    const size_t ranks = (size_t)group_count();
    bool done = true;
    for (size_t first = 0; first < choice->count && done; first += ranks) {
        if (group_stop_requested())
            break;
        if (label)
            progress_count(label, first, choice->count);
        const size_t left = choice->count - first, next = first + ranks;
        prefetch_photos(evaluation->scene, choice, next + (size_t)sgs_ranks_rank(group_ranks()));
        done = score_round(evaluation, choice->views + first, left < ranks ? left : ranks, scores);
    }
    return done;
}

// Copies the scores of all ranks into scores [view_count].
static bool share_scores(size_t views, rank_score *scores)
{
    const size_t count = (size_t)group_count(), bytes = views * sizeof *scores;
    rank_score *all = group_ranks() ? calloc(count, bytes + 1) : NULL;
    if (!group_ranks())
        return true;
    bool done = all != NULL;
    if (!done)
        fail_run("not enough memory for the scores of %zu views", views);
    done = group_all(done) && !sgs_ranks_gather(group_ranks(), SGS_STATUS_OK, scores, bytes, all);
    for (size_t i = 0; i < count * views && done; ++i)
        if (all[i].is_scored)
            scores[i % views] = all[i];
    free(all);
    return done;
}

bool evaluate_views(evaluator *evaluation, sgs_split split, size_t most, const char *label,
                    evaluate_save save, void *context, rank_score *scores)
{
    view_choice choice;
    bool done = group_all(choose_views(evaluation->scene, split, most, &choice));
    if (done) {
        done = evaluation->rank_renderer
                   ? score_together(evaluation, &choice, label, scores)
                   : score_own(evaluation, &choice, label, save, context, scores);
        progress_end();
        done = group_all(done) && share_scores(evaluation->scene->view_count, scores);
    }
    free(choice.views);
    return done;
}

bool evaluate_split(evaluator *evaluation, sgs_split split, size_t most, split_score *score)
{
    const sgs_scene *scene = evaluation->scene;
    const size_t all = scene_split_count(scene, split), count = all < most ? all : most;
    *score = (split_score){.views = count < all ? all : 0};
    split_score sum = *score;
    rank_score *scores = calloc(scene->view_count + 1, sizeof *scores);
    bool done = scores != NULL;
    if (!done)
        fail_run("not enough memory for the scores of %zu views", scene->view_count);
    done = group_all(done) && evaluate_views(evaluation, split, most,
                                             split == SGS_SPLIT_TEST ? "evaluating held-out images"
                                                                     : "evaluating training images",
                                             NULL, NULL, scores);
    size_t scored = 0;
    for (size_t v = 0; v < scene->view_count && done; ++v)
        if (scores[v].is_scored) {
            split_score_add(&sum, &scene->views[v], &scores[v].score);
            ++scored;
        }
    free(scores);
    split_score_finish(&sum);
    if (done && scored == count)
        *score = sum;
    else
        score->is_stopped = done;
    return done;
}

void view_score_add_json(json_t *object, const view_score *score)
{
    json_object_set_new(object, "psnr", json_number(score->psnr));
    json_object_set_new(object, "ssim", json_number(score->ssim));
    json_object_set_new(object, "flip", json_number(score->flip));
    json_object_set_new(object, "sharpness", json_number(score->sharpness));
    json_object_set_new(object, "lpips", json_number(score->lpips));
}

json_t *split_score_json(const split_score *score)
{
    json_t *object = json_object();
    json_object_set_new(object, "images", json_integer((json_int_t)score->images));
    json_object_set_new(object, "identical", json_integer((json_int_t)score->identical));
    const view_score none = {NAN, NAN, NAN, NAN, NAN, NAN};
    const view_score *mean = score->images ? &score->mean : &none;
    view_score_add_json(object, mean);
    json_object_set_new(object, "seconds_per_image", json_number(mean->seconds));
    return object;
}

char *sharpness_format(char text[SHARPNESS_TEXT], double sharpness, int width, int decimals)
{
    if (isnan(sharpness))
        snprintf(text, SHARPNESS_TEXT, "%*s", width, "-");
    else
        snprintf(text, SHARPNESS_TEXT, "%*.*f", width, decimals, sharpness);
    return text;
}

void split_score_print(const char *label, const split_score *score)
{
    if (!score->images)
        return;
    char sharpness[SHARPNESS_TEXT], lpips[32] = "", of[32] = "";
    if (!isnan(score->mean.lpips))
        snprintf(lpips, sizeof lpips, ", LPIPS %.4f", score->mean.lpips);
    if (score->views)
        snprintf(of, sizeof of, " of %zu", score->views);
    printf("%s PSNR %.2f dB, SSIM %.4f, FLIP %.4f, sharpness %s%s (%zu%s images%s, %.3g s per "
           "image)\n",
           label, score->mean.psnr, score->mean.ssim, score->mean.flip,
           sharpness_format(sharpness, score->mean.sharpness, 0, 3), lpips, score->images, of,
           score->identical ? ", some identical: 100 dB each" : "", score->mean.seconds);
}
