// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The rules of UsdGeomXformable: xformOpOrder names the operations of a prim, the last of which
// acts first. "!invert!" precedes the name of an inverse, and "!resetXformStack!" removes what
// precedes it and the transforms of the prims above. rotateXYZ turns about x first. Angles are in
// degrees, quaternions w x y z.

#include "formats/usd_transform.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sparegs/camera.h"

#define DEGREE (3.14159265358979323846 / 180.0)

static const char prefix[] = "xformOp:", invert[] = "!invert!", reset[] = "!resetXformStack!";

void sgsi_usd_transform_begin(sgsi_usd_transform *transform)
{
    transform->count = 0;
    transform->listed = 0;
    transform->resets = false;
    transform->crowded = false;
}

// ---- Matrices ----

void sgsi_usd_identity(double matrix[4][4])
{
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j)
            matrix[i][j] = i == j;
}

void sgsi_usd_multiply(double left[4][4], const double right[4][4])
{
    for (int i = 0; i < 4; ++i) {
        double row[4];
        memcpy(row, left[i], sizeof row);
        for (int j = 0; j < 4; ++j)
            left[i][j] = row[0] * right[0][j] + row[1] * right[1][j] + row[2] * right[2][j] +
                         row[3] * right[3][j];
    }
}

// By Gauss-Jordan elimination; not finite if the matrix is singular.
static void invert_matrix(double matrix[4][4])
{
    double result[4][4];
    sgsi_usd_identity(result);
    for (int column = 0; column < 4; ++column) {
        int pivot = column;
        for (int row = column + 1; row < 4; ++row)
            if (fabs(matrix[row][column]) > fabs(matrix[pivot][column]))
                pivot = row;
        const double inverse = 1.0 / matrix[pivot][column];
        for (int k = 0; k < 4; ++k) {
            const double a = matrix[column][k], b = result[column][k];
            matrix[column][k] = matrix[pivot][k] * inverse;
            result[column][k] = result[pivot][k] * inverse;
            if (pivot != column) {
                matrix[pivot][k] = a;
                result[pivot][k] = b;
            }
        }
        for (int row = 0; row < 4; ++row) {
            const double factor = matrix[row][column];
            for (int k = 0; row != column && k < 4; ++k) {
                matrix[row][k] -= factor * matrix[column][k];
                result[row][k] -= factor * result[column][k];
            }
        }
    }
    memcpy(matrix, result, sizeof result);
}

static void rotate_about(int axis, double degrees, double matrix[4][4])
{
    const int a = (axis + 1) % 3, b = (axis + 2) % 3; // a quarter turn moves a to b
    const double quarters = degrees / 90.0;
    double sine = sin(degrees * DEGREE), cosine = cos(degrees * DEGREE), turn[4][4];
    if (quarters == rint(quarters)) { // exactly
        sine = rint(sine);
        cosine = rint(cosine);
    }
    sgsi_usd_identity(turn);
    turn[a][a] = cosine;
    turn[a][b] = sine;
    turn[b][a] = -sine;
    turn[b][b] = cosine;
    sgsi_usd_multiply(matrix, turn);
}

static void orient(const double q[4], double matrix[4][4])
{
    const double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (norm == 0.0)
        return;
    const double w = q[0] / norm, x = q[1] / norm, y = q[2] / norm, z = q[3] / norm;
    const double rows[3][3] = {
        {1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)},
        {2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)},
        {2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)}};
    for (int i = 0; i < 3; ++i)
        memcpy(matrix[i], rows[i], sizeof rows[i]);
}

bool sgsi_usd_similarity(const double matrix[4][4], sgsi_similarity *similarity, bool *mirrored)
{
    double quaternion[4];
    const double volume =
        matrix[0][0] * (matrix[1][1] * matrix[2][2] - matrix[1][2] * matrix[2][1]) -
        matrix[0][1] * (matrix[1][0] * matrix[2][2] - matrix[1][2] * matrix[2][0]) +
        matrix[0][2] * (matrix[1][0] * matrix[2][1] - matrix[1][1] * matrix[2][0]);
    const double scale = cbrt(fabs(volume)), square = scale * scale;
    bool valid = isfinite(square) && square > 0.0 && fabs(matrix[3][3] - 1.0) < 1e-6;
    sgs_pose pose = {0};
    *mirrored = volume < 0.0;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            const double product = matrix[i][0] * matrix[j][0] + matrix[i][1] * matrix[j][1] +
                                   matrix[i][2] * matrix[j][2];
            valid = valid && fabs(product - (i == j ? square : 0.0)) < 2e-3 * square;
            pose.rotation[3 * j + i] = matrix[i][j] / (volume < 0.0 ? -scale : scale);
        }
    for (int k = 0; k < 3; ++k)
        valid = valid && isfinite(matrix[3][k]) && fabs(matrix[k][3]) < 1e-6;
    if (!valid)
        return false;
    sgs_pose_quaternion(&pose, quaternion);
    *similarity = sgsi_similarity_make(scale, quaternion, matrix[3]);
    return true;
}

// ---- Operations ----

// Number of values of an operation; 0 if its type is unknown.
static int value_count(const char *type, size_t length)
{
    static const struct {
        const char *type;
        int count;
    } types[] = {{"transform", 16}, {"translate", 3}, {"translateX", 1}, {"translateY", 1},
                 {"translateZ", 1}, {"scale", 3},     {"scaleX", 1},     {"scaleY", 1},
                 {"scaleZ", 1},     {"rotateX", 1},   {"rotateY", 1},    {"rotateZ", 1},
                 {"rotateXYZ", 3},  {"rotateXZY", 3}, {"rotateYXZ", 3},  {"rotateYZX", 3},
                 {"rotateZXY", 3},  {"rotateZYX", 3}, {"orient", 4}};
    for (size_t k = 0; k < sizeof types / sizeof *types; ++k)
        if (strlen(types[k].type) == length && !strncmp(types[k].type, type, length))
            return types[k].count;
    return 0;
}

// The matrix of an operation, whose number of values is right. `type` may have a suffix.
static void operation_matrix(const char *type, const double *values, double matrix[4][4])
{
    sgsi_usd_identity(matrix);
    if (!strncmp(type, "transform", 9)) {
        memcpy(matrix, values, 16 * sizeof *values);
    } else if (!strncmp(type, "orient", 6)) {
        orient(values, matrix);
    } else if (!strncmp(type, "rotate", 6)) {
        const char *axes = type + 6;
        for (int k = 0; axes[k] >= 'X' && axes[k] <= 'Z'; ++k)
            rotate_about(axes[k] - 'X',
                         values[axes[1] >= 'X' && axes[1] <= 'Z' ? axes[k] - 'X' : 0], matrix);
    } else {
        const bool scales = !strncmp(type, "scale", 5);
        const char axis = type[scales ? 5 : 9];
        for (int k = 0; k < 3; ++k)
            if (axis < 'X' || axis > 'Z' || axis - 'X' == k)
                *(scales ? &matrix[k][k] : &matrix[3][k]) =
                    values[axis < 'X' || axis > 'Z' ? k : 0];
    }
}

// Numbers in parentheses, or one number.
static int read_values(const char *text, locale_t c_locale, double values[16])
{
    int count = 0, open = 0;
    while (count < 16) {
        text += strspn(text, " \t\r\n,");
        if (*text == '(' || *text == ')') {
            open += *text++ == '(' ? 1 : -1;
        } else {
            char *end;
            values[count] = strtod_l(text, &end, c_locale);
            if (end == text)
                break;
            ++count;
            text = end;
        }
        if (open <= 0)
            break;
    }
    return count;
}

static sgsi_usd_operation *find_operation(sgsi_usd_transform *transform, const char *name,
                                          size_t length)
{
    for (int k = 0; k < transform->count; ++k)
        if (strlen(transform->operations[k].name) == length &&
            !strncmp(transform->operations[k].name, name, length))
            return &transform->operations[k];
    if (transform->count == SGSI_USD_OPERATIONS) {
        transform->crowded = true;
        return NULL;
    }
    sgsi_usd_operation *made = &transform->operations[transform->count++];
    *made = (sgsi_usd_operation){0};
    memcpy(made->name, name, length);
    return made;
}

void sgsi_usd_transform_set(sgsi_usd_transform *transform, const char *name, const char *text,
                            locale_t c_locale)
{
    const size_t length = strcspn(name, ".");
    const bool animated =
        !strcmp(name + length, ".timeSamples") || !strcmp(name + length, ".spline");
    if (length > SGSI_USD_NAME || (name[length] && !animated)) // a connection has no value
        return;
    sgsi_usd_operation *operation = find_operation(transform, name, length);
    if (!operation)
        return;
    operation->animated |= animated;
    text += strspn(text, " \t\r\n");
    if (animated || !strncmp(text, "None", 4))
        return;
    operation->given = true;
    operation->count = read_values(text, c_locale, operation->values);
}

void sgsi_usd_transform_order(sgsi_usd_transform *transform, const char *text)
{
    transform->listed = 0;
    transform->resets = false;
    text += strspn(text, " \t\r\n");
    if (*text++ != '[')
        return;
    for (;;) {
        text += strspn(text, " \t\r\n,");
        const char quote = *text;
        if (quote != '"' && quote != '\'')
            return;
        const char *start = ++text;
        for (; *text && *text != quote; ++text)
            ;
        size_t length = (size_t)(text - start);
        text += *text != 0;
        if (length == sizeof reset - 1 && !strncmp(start, reset, length)) {
            transform->resets = true;
            transform->listed = 0;
            continue;
        }
        const bool inverse =
            length > sizeof invert - 1 && !strncmp(start, invert, sizeof invert - 1);
        start += inverse ? sizeof invert - 1 : 0;
        length -= inverse ? sizeof invert - 1 : 0;
        if (transform->listed == SGSI_USD_OPERATIONS) {
            transform->crowded = true;
            return;
        }
        length = length < SGSI_USD_NAME ? length : SGSI_USD_NAME;
        char *name = transform->order[transform->listed].name;
        memcpy(name, start, length);
        name[length] = 0;
        transform->order[transform->listed++].inverse = inverse;
    }
}

sgsi_usd_fault sgsi_usd_transform_matrix(const sgsi_usd_transform *transform, double matrix[4][4])
{
    sgsi_usd_identity(matrix);
    for (int k = transform->listed - 1; k >= 0; --k) {
        const char *name = transform->order[k].name;
        const sgsi_usd_operation *found = NULL;
        for (int j = 0; j < transform->count; ++j)
            if (!strcmp(transform->operations[j].name, name))
                found = &transform->operations[j];
        if (found && found->animated)
            return SGSI_USD_ANIMATED;
        if (!found || !found->given)
            continue;
        const char *type = name + sizeof prefix - 1;
        double factor[4][4];
        if (found->count != value_count(type, strcspn(type, ":")) || !found->count)
            return SGSI_USD_INVALID;
        operation_matrix(type, found->values, factor);
        if (transform->order[k].inverse)
            invert_matrix(factor);
        sgsi_usd_multiply(matrix, factor);
    }
    return transform->crowded ? SGSI_USD_CROWDED : SGSI_USD_SOUND;
}
