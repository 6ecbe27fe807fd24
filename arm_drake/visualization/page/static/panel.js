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
    ...hear_plot,

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

// What is heard from the first on: the scene comes after its page.
const prepared = new WeakMap();
const prepare = (viewer) => {
    if (prepared.has(viewer)) return;
    prepared.set(viewer, watch_loading(viewer));
    follow_links(viewer);
    follow_scheme(viewer);
    fit_width(viewer);
};

// What takes longer is told, but not for ever: a mesh that can't be drawn never comes [ms].
const moment = 700, patience = 60000;
let since = performance.now();

const tell_loading = (viewer) => {
    const now = performance.now(), is_loading = !viewer || prepared.get(viewer).size;
    if (!is_loading) since = now;
    at("loading").hidden = now - since < moment || now - since > patience;
};

setInterval(() => {
    const {viewer} = at("scene").contentWindow;
    if (viewer) keep_above_ground(viewer), fit_width(viewer), prepare(viewer);
    tell_loading(viewer);
}, 250);

// ---- Folding and keys ----

const fold = (is_folded) => {
    at("panel").hidden = is_folded;
    at("unfold").hidden = !is_folded;
};
// Meshcat's own controls, which are another user interface over the scene.
const show_controls = (is_shown) => {
    const {viewer} = at("scene").contentWindow;
    if (viewer) viewer.gui.domElement.hidden = !is_shown;
};
at("controls").addEventListener("click", () => {
    const {viewer} = at("scene").contentWindow;
    if (viewer) show_controls(viewer.gui.domElement.hidden);
});
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

// Keys that drive, while they are down: said again and again, for Python lets go of them
// when it hears nothing.
const held = new Set();
const drives = /^(Arrow(Up|Down|Left|Right)|Digit[1-9])$/;
const is_driving = () => widgets.get("keys:on")?.widget.value;
const say_held = () => say("keys:held", [...held]);
const let_go = () => {
    if (held.size) held.clear(), say_held();
};
setInterval(() => {
    if (held.size) is_driving() ? say_held() : held.clear();
}, 200);

const hold = (event) => {
    const {code, ctrlKey, altKey, metaKey, shiftKey, target, type} = event;
    if (type === "keyup" ? !held.size : !is_driving()) return;
    const has_own = target.closest && target.closest("select, input[type=number], input[type=range]");
    if (type === "keydown" && (ctrlKey || altKey || metaKey || has_own)) return;
    const before = [...held].join();
    if (drives.test(code)) {
        type === "keydown" ? held.add(code) : held.delete(code);
        event.preventDefault();
    }
    if (![...held].some((key) => key !== "Shift")) held.clear();
    else shiftKey ? held.add("Shift") : held.delete("Shift");
    if ([...held].join() !== before) say_held();
};

const listen_to_keys = (window) => {
    window.addEventListener("keydown", press);
    for (const kind of ["keydown", "keyup"]) window.addEventListener(kind, hold);
};
listen_to_keys(window);
addEventListener("visibilitychange", let_go);
addEventListener("blur", () => {
    // The scene may have got the keyboard.
    if (document.activeElement !== at("scene")) let_go();
});
at("scene").addEventListener("load", () => {
    at("scene").contentWindow.addEventListener("blur", let_go);
    // The page itself tells when the connection is lost.
    const own = at("scene").contentDocument.getElementById("status-message");
    if (own) own.style.visibility = "hidden";
    show_controls(false);
    prepare(at("scene").contentWindow.viewer);
    listen_to_keys(at("scene").contentWindow);
    listen_to_clicks(at("scene").contentWindow, (path) => say("readout:pick", path));
    const has_hands = () => widgets.get("hands:drag");
    listen_to_drags(
        at("scene").contentWindow,
        ({shiftKey}) => has_hands() && (shiftKey || has_hands().widget.value),
        (drag) => say("hands:pull", drag),
        () => say("hands:release"));
});

connect();
requestAnimationFrame(draw_names);
