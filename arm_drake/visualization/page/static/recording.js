// A recording's page, beside Meshcat's own: it plays once all of it is drawn, with a bar
// of the widgets of widgets.js; scene.js keeps its camera above the ground.
"use strict";

const recording = (() => {
    // How many commands make the scene; whether it begins anew at its end.
    const settings = JSON.parse(document.currentScript.dataset.settings);

    // What takes longer to be drawn is not waited for [ms], and so much is played at most
    // between two pictures [s], of which the first take long.
    const patience = 20000, longest = 0.5;

    const rates = ["0.1 ×", "0.25 ×", "0.5 ×", "1 ×", "2 ×", "5 ×", "10 ×"];

    let viewer = null, commands = settings.commands, has_begun = false, is_playing = false;
    let time = 0, rate = 1, loop = settings.loop, last = 0, news = performance.now();

    // Objects that are to be drawn and aren't yet.
    let waiting = new Set();

    const note = () => { news = performance.now(); };

    Object.defineProperty(window, "viewer", {
        get: () => viewer,
        set: (made) => {
            viewer = made;
            waiting = watch_loading(viewer);
            // Once the page has set what it has by default.
            queueMicrotask(() => follow_scheme(viewer));
            beside(viewer, "handle_command_bytearray", nothing, () => { --commands, note(); });
            beside(viewer, "set_object", nothing, note);
            // Its own clock stands: what is seen is what the bar says.
            beside(viewer, "set_animation", nothing, () => viewer.animator.pause());
        },
    });

    const is_drawn = () => viewer && commands <= 0 && !waiting.size;

    const seek = (wanted) => {
        time = Math.min(Math.max(wanted, 0), viewer.animator.duration);
        viewer.animator.seek(time);
    };

    const play = () => {
        if (time >= viewer.animator.duration) seek(0);
        is_playing = true;
    };

    const advance = (passed) => {
        const {duration} = viewer.animator;
        const next = time + rate * Math.min(passed, longest);
        seek(loop && duration > 0 && next >= duration ? next % duration : next);
        is_playing = time < duration;
    };

    const patch = (id, change) => {
        const {widget, update} = widgets.get(id);
        if (Object.entries(change).every(([field, value]) => widget[field] === value)) return;
        Object.assign(widget, change);
        update();
    };

    const tick = (now) => {
        requestAnimationFrame(tick);
        if (!has_begun && (is_drawn() || now - news > patience)) {
            has_begun = true;
            patch("play", {is_enabled: true});
            patch("time", {is_enabled: true, upper: viewer.animator.duration});
            if (viewer.animator.duration > 0) play();
        } else if (is_playing) advance((now - last) / 1000);
        last = now;
        if (!has_begun) return;
        patch("play", {label: is_playing ? "pause" : "play"});
        patch("time", {value: time});
    };

    const handle = (id, value) => {
        if (id === "play" && is_playing) is_playing = false;
        else if (id === "play") play();
        else if (id === "time") seek(value);
        else if (id === "rate") rate = parseFloat(value);
        else if (id === "loop") {
            loop = value;
            if (loop && has_begun && time >= viewer.animator.duration) play();
        }
        else if (id === "controls") viewer.gui.domElement.hidden = !value;
    };

    addEventListener("DOMContentLoaded", () => {
        viewer.gui.domElement.hidden = true;
        document.body.append(make("footer", {id: "bar"},
            place("button", {id: "play", label: "loading…", hint: "play or pause (space)"}),
            place("slider", {
                id: "time", label: "time", lower: 0, upper: 0, value: 0, unit: "s", hint: "",
            }),
            place("choice", {id: "rate", label: "speed", options: rates, value: "1 ×"}),
            place("toggle", {id: "loop", label: "loop", value: loop}),
            place("toggle", {
                id: "controls", label: "Meshcat", value: false, hint: "Meshcat's own controls",
            })));
        requestAnimationFrame(tick);
        setInterval(() => { keep_above_ground(viewer), fit_width(viewer); }, 500);
    });
    addEventListener("keydown", (event) => {
        if (event.key !== " " || !has_begun || event.target.closest("button, input, select"))
            return;
        event.preventDefault();
        handle("play");
    });

    return {handle};
})();

const say = recording.handle;
