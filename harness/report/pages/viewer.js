// Looks closer at the images of a scene: test against reference by slider and flip, zoom that all images share, exposure
// and gamma on the stored radiance, and the numbers under the pointer.
//
// The page's pictures stand in a <figure> beside their numbers, <script class="pixels">. When one comes into view a
// viewer takes the pictures' place; without scripts they stay.
//
// Of kept libraries FlipBook (of simpleimageio 1.13) has no slider and no map of tiles, and is 224 kB of React out of a
// package that must be compiled; img-comparison-slider divides two elements, and knows no zoom and no radiance.
"use strict";

const LARGEST_ZOOM = 32;
const GRAB = 14;  // CSS pixels from the divider within which a drag moves it, where the image is zoomed

function element(tag, properties = {}, ...children) {
    const made = Object.assign(document.createElement(tag), properties);
    made.append(...children);
    return made;
}

class Viewer {
    // `stored`: the pixels of a scene; `palettes`: of the page's maps.
    static async on(figure, stored, palettes) {
        const viewer = new Viewer();
        Object.assign(viewer, {figure, stored, palettes, exposure: stored.exposure, gamma: 1, reach: 0, divider: 0.5,
            flipping: false, flipped: false, zoom: 1, left: 0, top: 0, pointed: null, front: 0, back: 1, tests: []});
        viewer.reference = await decode(stored.reference);
        await viewer.test(0);
        viewer.build();
        viewer.paint();
        return viewer;
    }

    get width() { return this.reference.width; }
    get height() { return this.reference.height; }

    // Another image under test.
    async test(number) {
        const one = this.stored.tests[number], {width, height} = this;
        this.tests[number] ??= {image: await decode(one.image), difference: await decode(one.difference),
            flip: await decode(one.flip), deviates: spread(await decode(one.deviates), one.tile, width, height)};
        const tested = this.tests[number], {difference_limit, deviate_limit, flip_limit} = this.stored;
        this.layers = [
            {title: `GLSL, ${one.name}`, image: tested.image},
            {title: this.stored.reference_name, image: this.reference},
            {title: "Relative difference", image: tested.difference, palette: "signed", limit: difference_limit,
             words: percent},
            {title: "Smaller tiles, z", image: tested.deviates, palette: "signed", limit: deviate_limit,
             words: value => signed(value, 3)},
            {title: "FLIP", image: tested.flip, palette: "flip", limit: flip_limit, words: digits}];
    }

    // -- elements

    build() {
        this.stage = element("canvas", {tabIndex: 0});
        this.stage.setAttribute("aria-label", "Test and reference; keys: F flips, 1 to 5 choose, + and − zoom, 0 fits");
        this.labels = [element("span", {className: "front"}), element("span", {className: "back"})];
        this.slider = element("input", {type: "range", className: "divider", min: 0, max: 1, step: 0.005});
        this.slider.setAttribute("aria-label", "Where the test ends and the reference begins");
        this.slider.value = this.divider;
        this.slider.oninput = () => this.divide(Number(this.slider.value));
        this.panels = this.layers.map((_, index) => this.panel(index));
        this.readout = element("table", {className: "readout"});
        const stage = element("div", {className: "stage"}, element("div", {className: "frame"}, this.stage,
            ...this.labels), this.slider, this.tools(), this.readout);
        const panels = element("div", {className: "panels"}, ...this.panels.map(panel => panel.button));
        this.root = element("div", {className: "viewer"}, stage, panels);
        this.root.style.setProperty("--ratio", `${this.width} / ${this.height}`);
        this.figure.prepend(this.root);
        this.figure.classList.add("viewed");
        this.canvases = [this.stage, ...this.panels.map(panel => panel.canvas)];
        this.canvases.forEach(canvas => this.listen(canvas));
        this.root.onkeydown = event => this.key(event);
        new ResizeObserver(() => this.draw()).observe(this.root);
        this.read();
    }

    panel(index) {
        const canvas = element("canvas"), title = element("span"), limits = element("span", {className: "limits"});
        const bar = element("canvas", {className: "scale", width: 255, height: 1});
        const button = element("button", {type: "button", title: `Show it large (${index + 1})`}, title, canvas);
        if (this.layers[index].palette)
            button.append(bar, limits);
        button.onclick = event => event.detail && this.dragged || this.choose(index);  // a key has no detail
        return {button, canvas, title, bar, limits};
    }

    tools() {
        const range = (name, words, settings, change) => {
            const input = element("input", {type: "range", name, ...settings}), told = element("output");
            const tell = () => told.textContent = words(Number(input.value));
            input.value = settings.value;
            input.oninput = () => { tell(); change(Number(input.value)); this.paint(); };
            tell();
            return element("label", {}, `${name} `, input, told);
        };
        const button = (words, title, act) => element("button", {type: "button", title, onclick: act}, words);
        const {exposure, tests} = this.stored;
        const choice = element("select", {name: "test", onchange: async () => {
            await this.test(choice.selectedIndex);
            this.paint();
        }}, ...tests.map(one => element("option", {}, one.name)));
        return element("div", {className: "tools"},
            ...(tests.length > 1 ? [element("label", {}, "Test ", choice)] : []),
            button("Flip", "Test or reference (F)", () => this.flip()),
            button("+", "Closer (+)", () => this.magnify(2)), button("−", "Farther (−)", () => this.magnify(0.5)),
            button("Fit", "The whole image (0)", () => this.magnify(0)),
            range("Exposure", value => `${signed(value)} stops`,
                {min: exposure - 10, max: exposure + 10, step: 0.25, value: exposure}, value => this.exposure = value),
            range("Gamma", value => value === 1 ? "sRGB" : digits(value), {min: 0.4, max: 3, step: 0.05, value: 1},
                value => this.gamma = value),
            range("Scale of maps", value => `× ${digits(2 ** value, 3)}`, {min: -6, max: 6, step: 1, value: 0},
                value => this.reach = value));
    }

    // -- what the reader does

    listen(canvas) {
        let from = null;
        canvas.onpointerdown = event => {
            const near = Math.abs(event.offsetX - this.divider * canvas.clientWidth) < GRAB;
            const divides = canvas === this.stage && (near && !this.flipping || this.zoom === 1);
            from = {x: event.offsetX, y: event.offsetY, left: this.left, top: this.top, divides};
            this.dragged = false;
            canvas.setPointerCapture(event.pointerId);
        };
        canvas.onpointermove = event => {
            this.point(canvas, event);
            if (!from)
                return;
            const x = event.offsetX - from.x, y = event.offsetY - from.y;
            this.dragged ||= Math.hypot(x, y) > 3;
            if (this.dragged && from.divides)
                this.divide(event.offsetX / canvas.clientWidth);
            else if (this.dragged) {
                const scale = this.width / canvas.clientWidth / this.zoom;
                this.look(from.left - x * scale, from.top - y * scale);
            }
        };
        canvas.onpointerup = canvas.onpointercancel = () => {
            if (from && !this.dragged && canvas === this.stage)
                this.flip();
            from = null;
        };
        canvas.onpointerleave = () => { this.pointed = null; this.read(); this.draw(); };
        canvas.addEventListener("wheel", event => {
            if (!event.ctrlKey && !this.root.contains(document.activeElement))
                return;  // the page scrolls until a viewer was clicked
            event.preventDefault();
            this.magnify(2 ** (-event.deltaY / 240), this.place(canvas, event));
        }, {passive: false});
    }

    key(event) {
        if (event.target.tagName === "INPUT" || event.target.tagName === "SELECT" || event.ctrlKey || event.metaKey)
            return;
        const step = this.width / this.zoom / 10;
        const acts = {f: () => this.flip(), "+": () => this.magnify(2), "=": () => this.magnify(2),
            "-": () => this.magnify(0.5), "0": () => this.magnify(0), ArrowLeft: () => this.look(this.left - step),
            ArrowRight: () => this.look(this.left + step), ArrowUp: () => this.look(this.left, this.top - step),
            ArrowDown: () => this.look(this.left, this.top + step)};
        const layer = "12345".indexOf(event.key);
        const act = layer >= 0 ? () => this.choose(layer) : acts[event.key.length === 1 ? event.key.toLowerCase()
                                                                                       : event.key];
        if (act) {
            event.preventDefault();
            act();
        }
    }

    choose(index) {
        this.front = index;
        this.back = index === 1 ? 0 : 1;
        this.flipped = false;
        this.draw();
    }

    flip() {
        this.flipped = !this.flipping || !this.flipped;
        this.flipping = true;
        this.draw();
    }

    divide(place) {
        this.flipping = false;
        this.divider = Math.min(Math.max(place, 0), 1);
        this.slider.value = this.divider;
        this.draw();
    }

    // Closer by a factor, around a place (in pixels of the image), the middle if none is given; 0: the whole image.
    magnify(factor, around) {
        const before = this.zoom, {x, y} = around ?? {x: this.left + this.width / before / 2,
            y: this.top + this.height / before / 2};
        this.zoom = factor ? Math.min(Math.max(before * factor, 1), LARGEST_ZOOM) : 1;
        this.root.classList.toggle("zoomed", this.zoom > 1);
        this.look(x - (x - this.left) * before / this.zoom, y - (y - this.top) * before / this.zoom);
    }

    look(left, top = this.top) {
        const {width, height, zoom} = this;
        this.left = Math.min(Math.max(left, 0), width - width / zoom);
        this.top = Math.min(Math.max(top, 0), height - height / zoom);
        this.draw();
    }

    place(canvas, event) {
        return {x: this.left + event.offsetX / canvas.clientWidth * this.width / this.zoom,
            y: this.top + event.offsetY / canvas.clientHeight * this.height / this.zoom};
    }

    point(canvas, event) {
        const {x, y} = this.place(canvas, event);
        const inside = x >= 0 && y >= 0 && x < this.width && y < this.height;
        this.pointed = inside ? {x: Math.floor(x), y: Math.floor(y)} : null;
        this.read();
        this.draw();
    }

    // -- what is shown

    // The numbers as colours anew: after another test, exposure, gamma or reach of the maps.
    paint() {
        for (const [index, layer] of this.layers.entries()) {
            const {title, bar, limits} = this.panels[index];
            title.textContent = layer.title;
            let pixels;
            if (layer.palette) {
                const high = layer.limit * 2 ** this.reach, low = layer.palette === "signed" ? -high : 0;
                const palette = this.palettes[layer.palette];
                pixels = mapped(layer.image, palette, low, high);
                const ramp = {width: 255, height: 1, values: Float32Array.from({length: 255}, (_, i) => i / 254)};
                bar.getContext("2d").putImageData(mapped(ramp, palette, 0, 1), 0, 0);
                limits.replaceChildren(...[low, (low + high) / 2, high].map(value =>
                    element("span", {}, value ? layer.words(value) : "0")));
            } else
                pixels = displayed(layer.image, this.exposure, this.gamma);
            layer.picture = element("canvas", {width: pixels.width, height: pixels.height});
            layer.picture.getContext("2d").putImageData(pixels, 0, 0);
        }
        this.read();
        this.draw();
    }

    draw() {
        this.waiting ??= requestAnimationFrame(() => {
            this.waiting = null;
            this.panels.forEach(({canvas, button}, index) => {
                this.put(canvas, index);
                button.setAttribute("aria-pressed", index === this.front);
            });
            this.put(this.stage, this.flipping && this.flipped ? this.back : this.front);
            const context = this.stage.getContext("2d"), edge = Math.round(this.divider * this.stage.width);
            if (!this.flipping) {
                this.put(this.stage, this.back, edge);
                context.setTransform(1, 0, 0, 1, 0, 0);
                context.fillStyle = "#ffffff";
                context.fillRect(edge - 1, 0, 2, this.stage.height);
            }
            const [front, back] = this.labels;
            front.textContent = this.layers[this.front].title;
            back.textContent = this.layers[this.back].title;
            front.hidden = this.flipping && this.flipped;
            back.hidden = this.flipping && !this.flipped;
        });
    }

    // One layer on a canvas, from a column of it on; and a frame around the pixel that is pointed at.
    put(canvas, index, from = 0) {
        const picture = this.layers[index].picture;
        if (!picture || !canvas.clientWidth)
            return;
        const context = canvas.getContext("2d"), ratio = window.devicePixelRatio || 1;
        if (!from) {
            const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
            if (canvas.width !== width || canvas.height !== height)
                Object.assign(canvas, {width, height});
        }
        const scale = canvas.width / this.width * this.zoom;
        context.save();
        context.beginPath();
        context.rect(from, 0, canvas.width - from, canvas.height);
        context.clip();
        context.imageSmoothingEnabled = false;
        context.setTransform(scale, 0, 0, canvas.height / this.height * this.zoom, -this.left * scale,
            -this.top * canvas.height / this.height * this.zoom);
        context.drawImage(picture, 0, 0);
        if (this.pointed) {
            const margin = 3 * ratio / scale, {x, y} = this.pointed;
            for (const [colour, line] of [["#000000", 3], ["#ffffff", 1]]) {
                context.strokeStyle = colour;
                context.lineWidth = line * ratio / scale;
                context.strokeRect(x - margin, y - margin, 1 + 2 * margin, 1 + 2 * margin);
            }
        }
        context.restore();
    }

    // The numbers of the pixel that is pointed at.
    read() {
        const {x, y} = this.pointed ?? {}, index = y * this.width + x, count = this.width * this.height;
        const at = (image, channel) => this.pointed ? image.values[channel * count + index] : NaN;
        const row = (name, ...cells) => element("tr", {}, element("th", {scope: "row"}, name),
            ...cells.map(text => element("td", {colSpan: cells.length === 1 ? 4 : 1}, text)));
        const heads = element("tr", {}, element("th", {}, this.pointed ? `x ${x}, y ${y}` : "Point at a pixel"),
            ...["R", "G", "B", "Y"].map(name => element("th", {scope: "col"}, name)));
        const rows = this.layers.map(({title, image, palette, words}) => {
            if (palette)
                return row(title, words(at(image, 0)));
            const colours = [0, 1, 2].map(channel => at(image, channel));
            const luminance = colours.reduce((sum, value, channel) => sum + LUMINANCE[channel] * value, 0);
            return row(title, ...[...colours, luminance].map(value => digits(value)));
        });
        this.readout.replaceChildren(heads, ...rows);
    }
}

// One viewer for each figure that has pixels, made when it is about to be seen; none where the browser is too old.
function viewers() {
    if (!("DecompressionStream" in window && "IntersectionObserver" in window && "ResizeObserver" in window))
        return;
    const held = document.getElementById("palettes");
    const palettes = held ? Object.fromEntries(Object.entries(JSON.parse(held.textContent)).map(([name, data]) =>
        [name, Uint8Array.from(atob(data), letter => letter.charCodeAt(0))])) : {};
    const coming = new IntersectionObserver(seen => seen.filter(entry => entry.isIntersecting).forEach(({target}) => {
        coming.unobserve(target);
        Viewer.on(target, JSON.parse(target.querySelector("script.pixels").textContent), palettes);
    }), {rootMargin: "600px"});
    document.querySelectorAll("script.pixels").forEach(script => coming.observe(script.closest("figure")));
}
