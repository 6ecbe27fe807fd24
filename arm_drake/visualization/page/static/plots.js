// Live plots below the scene: what Python samples, drawn by uPlot, which is loaded with
// the first curve. What is looked at (how long, paused, zoomed) is each browser's own.
"use strict";

const colors = ["#1667b7", "#d1495b", "#2e8b57", "#e08e0b", "#7b4fb5", "#139aa5",
    "#a0522d", "#c2378b", "#6b7f12", "#4a5a6a", "#e4572e", "#3b60e4"];

// Rows that are kept, as in Python.
const most_rows = 30000;

const plots = {
    curves: [], rows: [], chart: null, loading: null,
    // The last so many seconds, 0 is all; whether it stands; the range that was zoomed to.
    last: 20, is_paused: false, zoom: null,
};

const load_uplot = () => plots.loading ??= new Promise((done) => {
    document.head.append(make("link", {rel: "stylesheet", href: "uplot/uPlot.min.css"}));
    document.head.append(make("script", {src: "uplot/uPlot.iife.min.js", onload: done}));
});

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);

// Returns the rows as uPlot takes them: a list for each column.
const columns = () => [...Array(plots.curves.length + 1).keys()]
    .map((k) => plots.rows.map((row) => row[k]));

const show_values = (index) => {
    const row = plots.shown?.[0].length ? plots.shown.map((column) => column[index ?? column.length - 1]) : [];
    document.querySelectorAll("#plot .curve .value").forEach((span, k) => {
        span.textContent = row[k + 1] == null ? "–" : row[k + 1].toPrecision(5);
    });
    at("plot-time").textContent = row[0] == null ? "" : `${row[0].toFixed(2)} s`;
};

// Draws what is new, unless it stands still.
const redraw = () => {
    if (plots.chart && !plots.rows.length) plots.chart.setData(plots.shown = columns(), false);
    if (!plots.chart || plots.is_paused || plots.zoom || !plots.rows.length) return;
    const end = plots.rows.at(-1)[0];
    const first = plots.rows[0][0];
    const start = plots.last ? Math.max(end - plots.last, first) : first;
    plots.shown = columns();
    plots.chart.setData(plots.shown, false);
    plots.chart.setScale("x", {min: start, max: Math.max(end, start + 1e-3)});
    if (plots.chart.cursor.idx == null) show_values();
};

const set_paused = (is_paused) => {
    plots.is_paused = is_paused;
    plots.zoom = null;
    at("plot-pause").textContent = is_paused ? "go on" : "pause";
    redraw();
};

const make_chart = () => {
    plots.chart?.destroy();
    const [text, line] = [css("--text"), css("--line")];
    const axis = {stroke: text, grid: {stroke: line, width: 1}, ticks: {stroke: line, width: 1}};
    const {clientWidth: width, clientHeight: height} = at("plot-area");
    plots.shown = columns();
    plots.chart = new uPlot({
        width, height, legend: {show: false},
        scales: {x: {time: false}},
        axes: [{...axis, label: "time [s]", labelSize: 16, size: 34}, {...axis, size: 60}],
        series: [{}, ...plots.curves.map((label, k) => ({
            label, stroke: colors[k % colors.length], width: 1.5, points: {show: false},
        }))],
        cursor: {
            drag: {x: true, y: false},
            bind: {dblclick: () => () => set_paused(false)},
        },
        hooks: {
            setCursor: [({cursor}) => show_values(cursor.idx)],
            setSelect: [({select, posToVal}) => {
                if (!select.width) return;
                plots.zoom = [posToVal(select.left, "x"), posToVal(select.left + select.width, "x")];
                at("plot-pause").textContent = "go on";
            }],
        },
    }, plots.shown, at("plot-area"));
    redraw();
};

const show_curves = () => {
    const chips = plots.curves.map((name, k) => {
        const remove = make("button", {textContent: "×", title: `plot ${name} no more`});
        remove.addEventListener("click", () => say("plot:remove", name));
        const swatch = make("span", {className: "swatch"});
        swatch.style.background = colors[k % colors.length];
        const value = make("span", {className: "value"});
        return make("span", {className: "curve"}, swatch, ...breakable(name), value, remove);
    });
    at("plot-curves").replaceChildren(...chips);
};

const hear_plot = {
    plot({curves, rows}) {
        const is_same = plots.chart && curves.join() === plots.curves.join();
        plots.rows = rows;
        plots.curves = curves;
        at("plot").hidden = !curves.length;
        document.body.classList.toggle("has-plot", curves.length > 0);
        if (!curves.length) {
            plots.chart?.destroy();
            plots.chart = null;
            return;
        }
        if (is_same) return set_paused(plots.is_paused);
        show_curves();
        load_uplot().then(() => plots.curves.length && make_chart());
    },

    samples({rows}) {
        plots.rows.push(...rows);
        plots.rows.splice(0, plots.rows.length - most_rows);
        redraw();
    },
};

// ---- Files ----

const download = (name, blob) => {
    const link = make("a", {href: URL.createObjectURL(blob), download: name});
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
};

const save_csv = () => {
    const quote = (text) => /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
    const head = ["time", ...plots.curves.map(quote)].join(",");
    const lines = plots.rows.map((row) => row.map((number) => number ?? "").join(","));
    download("plot.csv", new Blob([[head, ...lines, ""].join("\n")], {type: "text/csv"}));
};

// What is seen, with the curves' names above it.
const save_png = () => {
    const chart = plots.chart.ctx.canvas;
    const scale = devicePixelRatio;
    const [size, pad] = [14 * scale, 8 * scale];
    const canvas = make("canvas", {
        width: chart.width, height: chart.height + pad + size * 1.4 * plots.curves.length});
    const pen = canvas.getContext("2d");
    pen.fillStyle = css("--paper");
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.font = `${size}px sans-serif`;
    plots.curves.forEach((name, k) => {
        pen.fillStyle = colors[k % colors.length];
        pen.fillText(name, pad, pad + size * (1 + 1.4 * k));
    });
    pen.drawImage(chart, 0, canvas.height - chart.height);
    canvas.toBlob((blob) => download("plot.png", blob));
};

at("plot-pause").addEventListener("click", () => set_paused(!(plots.is_paused || plots.zoom)));
at("plot-last").addEventListener("change", () => {
    plots.last = Number(at("plot-last").value);
    set_paused(false);
});
at("plot-clear").addEventListener("click", () => say("plot:clear"));
at("plot-close").addEventListener("click", () => say("plot:close"));
at("plot-csv").addEventListener("click", save_csv);
at("plot-png").addEventListener("click", save_png);
new ResizeObserver(() => {
    const {clientWidth: width, clientHeight: height} = at("plot-area");
    if (plots.chart && width && height) plots.chart.setSize({width, height});
}).observe(at("plot-area"));
