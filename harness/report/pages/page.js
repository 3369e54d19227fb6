// What a page of the report does besides its viewers: light or dark, and the values of charts under the pointer.
"use strict";

// ---- light and dark: as the system has it, until the reader chooses

function theme() {
    const root = document.documentElement, system = matchMedia("(prefers-color-scheme: dark)");
    const button = element("button", {type: "button", className: "theme"});
    const dark = () => root.dataset.theme ? root.dataset.theme === "dark" : system.matches;
    const tell = () => button.textContent = dark() ? "Light page" : "Dark page";
    try {
        root.dataset.theme = localStorage.getItem("theme") ?? "";
    } catch { /* a page from a file may have no storage */ }
    button.onclick = () => {
        root.dataset.theme = dark() ? "light" : "dark";
        try {
            localStorage.setItem("theme", root.dataset.theme);
        } catch { /* then it is chosen anew each time */ }
        tell();
    };
    system.onchange = tell;
    tell();
    document.querySelector("nav")?.append(button);
}

// ---- charts: the marker nearest to the pointer says its value, which the file holds as its <title>

const REACH = 24;  // CSS pixels

function charts() {
    const tip = element("div", {className: "tip", hidden: true});
    document.body.append(tip);
    const ring = document.createElementNS("http://www.w3.org/2000/svg", "circle");
    ring.setAttribute("class", "pointed");
    ring.setAttribute("r", 4);  // points of the figure
    for (const chart of document.querySelectorAll(".curves svg")) {
        const points = [...chart.querySelectorAll("use > title")].map(title => {
            const marker = title.parentElement, words = title.textContent;
            title.remove();  // or the browser would show it as well
            return {marker, words};
        });
        const hide = () => {
            tip.hidden = true;
            ring.remove();
        };
        chart.onpointermove = event => {
            hide();
            const near = points.map(({marker, words}) => {
                const place = new DOMPoint(marker.x.baseVal.value, marker.y.baseVal.value)
                    .matrixTransform(marker.parentElement.getScreenCTM());
                return {marker, words, place, far: Math.hypot(place.x - event.clientX, place.y - event.clientY)};
            }).reduce((best, each) => each.far < best.far ? each : best, {far: REACH});
            if (!near.marker)
                return;
            ring.setAttribute("cx", near.marker.x.baseVal.value);
            ring.setAttribute("cy", near.marker.y.baseVal.value);
            near.marker.after(ring);
            tip.textContent = near.words.replaceAll("; ", "\n");
            tip.hidden = false;
            const left = Math.min(near.place.x + 12, innerWidth - tip.offsetWidth - 8);
            tip.style.left = `${Math.max(left, 4) + scrollX}px`;
            tip.style.top = `${near.place.y - tip.offsetHeight - 10 + scrollY}px`;
        };
        chart.onpointerleave = hide;
    }
}

theme();
charts();
viewers();
