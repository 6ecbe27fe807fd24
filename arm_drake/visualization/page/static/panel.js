// The panel of a page: what Python describes, made of the widgets of widgets.js.
"use strict";

// ---- The connection ----

let socket = null;
let was_connected = false;

// What waits to be said, the latest of each widget: a slider's way is not a queue.
const waiting = new Map();

const speak = () => {
    for (const [id, value] of waiting) socket.send(JSON.stringify({id, value}));
    waiting.clear();
};

const say = (id, value) => {
    if (!socket || socket.readyState !== WebSocket.OPEN) return;
    if (value === undefined) {
        speak(); // What was set before a click counts before it.
        socket.send(JSON.stringify({id}));
        return;
    }
    if (!waiting.size) requestAnimationFrame(speak);
    waiting.set(id, value);
};

// ---- What Python says ----

const folded = new Map();

const hear = {
    panel({title, sections}) {
        document.title = title;
        at("title").textContent = title;
        widgets.clear();
        const elements = sections.map((section) => {
            const is_open = folded.get(section.title) ?? section.is_open;
            const summary = make("summary", {textContent: section.title});
            const details = make("details", {open: is_open}, summary);
            details.addEventListener("toggle", () => folded.set(section.title, details.open));
            for (const {kind, ...fields} of section.widgets) details.append(place(kind, fields));
            return details;
        });
        at("sections").replaceChildren(...elements);
    },

    patch({changes}) {
        for (const [id, change] of Object.entries(changes)) {
            const there = widgets.get(id);
            if (!there) continue;
            Object.assign(there.widget, change);
            there.update();
        }
    },

    message({text, severity}) {
        at("message").textContent = text;
        at("message").className = severity;
        at("message").hidden = !text;
    },

    labels({labels}) {
        names.clear();
        at("labels").replaceChildren();
        for (const [path, text] of Object.entries(labels)) {
            const span = make("span", {textContent: text});
            at("labels").append(span);
            const {offsetWidth, offsetHeight} = span;
            names.set(path.split("/").filter(Boolean), {span, offsetWidth, offsetHeight});
        }
    },
};

const connect = () => {
    const url = new URL("panel", location.href);
    url.protocol = url.protocol.replace("http", "ws");
    socket = new WebSocket(url);
    socket.onopen = () => {
        if (was_connected) location.reload(); // The program has started again.
        was_connected = true;
    };
    socket.onmessage = ({data}) => {
        const message = JSON.parse(data);
        hear[message.type](message);
    };
    socket.onclose = () => {
        at("lost").hidden = !was_connected;
        at("sections").inert = was_connected; // Nobody hears what is clicked.
        setTimeout(connect, 500);
    };
};

// ---- Names beside frames: they follow the scene's camera ----

const names = new Map();

const transform = (e, x, y, z) => [0, 1, 2, 3].map((i) => e[i] * x + e[i + 4] * y + e[i + 8] * z + e[i + 12]);

const draw_names = () => {
    requestAnimationFrame(draw_names);
    const viewer = names.size && at("scene").contentWindow.viewer;
    if (!viewer) return;
    const {clientWidth: width, clientHeight: height} = at("labels");
    const {matrixWorldInverse, projectionMatrix} = viewer.camera;
    const taken = [];
    for (const [path, {span, offsetWidth, offsetHeight}] of names) {
        const e = viewer.scene_tree.find(path).object.matrixWorld.elements;
        const seen = transform(matrixWorldInverse.elements, e[12], e[13], e[14]);
        const [x, y, , w] = transform(projectionMatrix.elements, ...seen);
        span.hidden = w <= 0;
        if (span.hidden) continue;
        const left = (0.5 + 0.5 * x / w) * width + 6;
        // Below those whose place it would take; half a pixel, as numbers are rounded.
        let top = (0.5 - 0.5 * y / w) * height - 8;
        for (let other; (other = taken.find((t) => Math.abs(t.top - top) < offsetHeight - 0.5
            && left < t.right && t.left < left + offsetWidth));) top = other.top + offsetHeight;
        taken.push({left, right: left + offsetWidth, top});
        span.style.transform = `translate(${left.toFixed(1)}px, ${top.toFixed(1)}px)`;
    }
};

// ---- The camera stays above the ground, where there is one ----

const above = Math.PI / 2 - 0.02;

setInterval(() => {
    const viewer = at("scene").contentWindow.viewer;
    if (!viewer) return;
    const grid = viewer.scene_tree.children.Grid;
    const ground = grid && grid.children.ground;
    const nodes = ground ? [grid, ground, ground.children.plane] : [null];
    const has_ground = nodes.every((node) => node && node.object.visible);
    viewer.controls.maxPolarAngle = has_ground ? above : Math.PI;
}, 500);

// ---- Folding and keys ----

const fold = (is_folded) => {
    at("panel").hidden = is_folded;
    at("unfold").hidden = !is_folded;
};
at("fold").addEventListener("click", () => fold(true));
at("unfold").addEventListener("click", () => fold(false));
if (new URLSearchParams(location.search).has("no_panel")
    || matchMedia("(max-width: 600px)").matches) fold(true);

// What has the keyboard needs some keys itself: a number all, a button those that click.
const needs = (element, key) => element.closest && element.closest(
    key === " " || key === "Enter"
        ? "button, summary, select, input:not([type=range])" : "select, input[type=number]");

const press = (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (needs(event.target, event.key)) return;
    for (const {widget} of widgets.values())
        if (widget.key && widget.key === event.key && widget.is_enabled) {
            event.preventDefault();
            say(widget.id);
            return;
        }
};
addEventListener("keydown", press);
at("scene").addEventListener("load", () => {
    // The page itself tells when the connection is lost.
    const own = at("scene").contentDocument.getElementById("status-message");
    if (own) own.style.visibility = "hidden";
    at("scene").contentWindow.addEventListener("keydown", press);
});

connect();
requestAnimationFrame(draw_names);
