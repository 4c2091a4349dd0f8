// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Parses a .usda file with tinyusdz, a strict reader of OpenUSD, and prints "PRIMITIVES CAMERAS":
//     node usda_counts.mjs FOLDER_OF_TINYUSDZ FILE.usda
// Fails with the error of the reader, or if an attribute of the splats is missing.

import fs from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

process.type = 'renderer'; // the module was built for browsers
globalThis.window = globalThis;
const [folder, file] = process.argv.slice(2);
const module = await import(pathToFileURL(path.join(folder, 'tinyusdz.js')));
const tinyusdz = await module.default({ wasmBinary: fs.readFileSync(path.join(folder, 'tinyusdz.wasm')) });
const loader = new tinyusdz.TinyUSDZLoaderNative();
if (!loader.loadAsLayerFromBinary(new Uint8Array(fs.readFileSync(file)), path.basename(file))) {
    console.error(loader.error());
    process.exit(1);
}
const text = loader.layerToString();
const count = (name) => {
    const found = text.match(new RegExp(`${name} = \\[([^\\]]*)\\]`));
    if (!found) {
        console.error(`attribute ${name} is missing`);
        process.exit(1);
    }
    return found[1].includes('(') ? found[1].split('(').length - 1 : found[1].split(',').length;
};
const counts = ['positions', 'orientations', 'scales', 'opacities'].map(count);
const coefficients = count('radiance:sphericalHarmonicsCoefficients');
if (new Set(counts).size !== 1 || coefficients % counts[0] !== 0) {
    console.error(`the arrays have ${counts.join(', ')} and ${coefficients} items`);
    process.exit(1);
}
for (const part of ['ParticleField3DGaussianSplat', 'rayHitDistance', 'elementSize']) {
    if (!text.includes(part)) {
        console.error(`${part} is missing`);
        process.exit(1);
    }
}
console.log(`${counts[0]} ${text.split('def Camera').length - 1}`);
