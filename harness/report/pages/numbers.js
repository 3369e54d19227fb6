// The numbers of images: as they are stored in the page (pages/embedded.py), as colours, and as words.
"use strict";

const BROKEN = [255, 0, 255], UNDEFINED = [160, 160, 160];  // NaN in an image, and in a map; as in the pictures
const LUMINANCE = [0.2126, 0.7152, 0.0722];  // Rec.709

// ---- stored numbers

// Every half float (IEEE 754, binary16) by its bits.
const halves = (() => {
    let table = null;
    return () => table ??= Float32Array.from({length: 65536}, (_, bits) => {
        const exponent = bits >> 10 & 31, mantissa = bits & 1023;
        const size = exponent === 0 ? mantissa * 2 ** -24
            : exponent === 31 ? (mantissa ? NaN : Infinity) : (1 + mantissa / 1024) * 2 ** (exponent - 15);
        return bits & 32768 ? -size : size;
    });
})();

// A stored plane as {width, height, channels, values}: values stand channel after channel, row after row.
async function decode({width, height, channels, data}) {
    const packed = Uint8Array.from(atob(data), letter => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    const count = width * height * channels, table = halves(), values = new Float32Array(count);
    for (let i = 0; i < count; i++)
        values[i] = table[bytes[i] << 8 | bytes[count + i]];
    return {width, height, channels, values};
}

// ---- numbers as colours

const srgb = value => value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;

// Radiance as a display shows it: times 2^exposure, clipped, sRGB-encoded (IEC 61966-2-1), and to the power 1/gamma.
function displayed(image, exposure, gamma) {
    const pixels = new ImageData(image.width, image.height), count = image.width * image.height;
    const scale = 2 ** exposure;
    for (let i = 0; i < count; i++) {
        let broken = false;
        for (let channel = 0; channel < 3; channel++) {
            const value = srgb(Math.min(Math.max(image.values[channel * count + i] * scale, 0), 1)) ** (1 / gamma);
            broken ||= Number.isNaN(value);
            pixels.data[4 * i + channel] = Math.round(255 * value);
        }
        if (broken)
            pixels.data.set(BROKEN, 4 * i);
        pixels.data[4 * i + 3] = 255;
    }
    return pixels;
}

// Numbers of one channel through a palette from `low` to `high`; what lies outside saturates.
function mapped(image, palette, low, high) {
    const pixels = new ImageData(image.width, image.height), last = palette.length / 3 - 1;
    image.values.forEach((value, i) => {
        const level = Math.round(Math.min(Math.max((value - low) / (high - low), 0), 1) * last);
        pixels.data.set(Number.isNaN(value) ? UNDEFINED : palette.subarray(3 * level, 3 * level + 3), 4 * i);
        pixels.data[4 * i + 3] = 255;
    });
    return pixels;
}

// One number for each tile, at each pixel of an image.
function spread(tiles, tile, width, height) {
    const values = Float32Array.from({length: width * height}, (_, i) => {
        const x = Math.floor((i % width) / tile), y = Math.floor(Math.floor(i / width) / tile);
        return x < tiles.width && y < tiles.height ? tiles.values[y * tiles.width + x] : NaN;
    });
    return {width, height, channels: 1, values};
}

// ---- numbers as words

const minus = text => text.replace("-", "−");
const digits = (value, count = 4) => Number.isFinite(value) ? minus(String(Number(value.toPrecision(count)))) : "–";
const signed = (value, count) => (value > 0 ? "+" : "") + digits(value, count);
const percent = value => Number.isFinite(value) ? `${signed(100 * value, 3)} %` : "–";
