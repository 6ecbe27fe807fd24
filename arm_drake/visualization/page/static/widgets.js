// The widgets of a panel, as Python describes them (widgets.py): each has an element,
// and takes changes of its fields. What is done with one is said with `say(id, value)`.
"use strict";

const at = (id) => document.getElementById(id);

// Makes an element.
const make = (tag, properties = {}, ...children) => {
    const element = Object.assign(document.createElement(tag), properties);
    element.append(...children);
    return element;
};

// Numbers as short as they can be told apart on a slider.
const short = (number) => String(Math.round(number * 1e4) / 1e4);

// A name that may be broken between its words, not within them.
const breakable = (name) => name.split(/(?<=[_:/.-])(?![_:/.-])/)
    .flatMap((word) => [word, make("wbr")]);

const widgets = new Map();

const makers = {
    slider(w) {
        const range = make("input", {type: "range", step: "any"});
        const number = make("input", {type: "number", step: "any"});
        const label = make("label", {}, ...breakable(w.label));
        const unit = make("span", {className: "unit"});
        const [lower, upper] = [make("span"), make("span")];
        const ends = make("div", {className: "ends"}, lower, upper);
        const element = make("div", {title: w.hint}, label, number, unit, range, ends);
        range.setAttribute("aria-label", w.label);
        number.setAttribute("aria-label", `${w.label}, value`);
        let is_held = false;
        range.addEventListener("pointerdown", () => { is_held = true; });
        for (const end of ["pointerup", "pointercancel", "change"])
            range.addEventListener(end, () => { is_held = false; });
        range.addEventListener("input", () => {
            number.value = short(range.valueAsNumber);
            say(w.id, range.valueAsNumber);
        });
        number.addEventListener("change", () => {
            if (Number.isFinite(number.valueAsNumber)) say(w.id, number.valueAsNumber);
            number.blur(); // What becomes of it, within the range, is told.
        });
        const update = () => {
            element.className = `widget slider${w.is_enabled ? "" : " disabled"}`;
            range.disabled = number.disabled = !w.is_enabled;
            unit.textContent = w.unit;
            lower.textContent = short(w.lower);
            upper.textContent = short(w.upper);
            range.min = w.lower;
            range.max = w.upper;
            if (is_held) return;
            range.value = w.value;
            if (document.activeElement !== number || !number.matches(":focus"))
                number.value = short(w.value);
        };
        number.addEventListener("blur", update);
        return [element, update];
    },

    button(w) {
        const element = make("button", {title: w.hint});
        let is_asking = false;
        const ask = (asks) => {
            is_asking = asks;
            update();
        };
        element.addEventListener("click", () => {
            const is_meant = is_asking || !w.question;
            if (is_meant) say(w.id);
            else setTimeout(ask, 4000, false);
            ask(!is_meant);
        });
        const update = () => {
            element.textContent = is_asking ? w.question : w.label;
            element.disabled = !w.is_enabled;
        };
        return [element, update];
    },

    buttons(w) {
        const element = make("div", {className: "widget buttons"});
        for (const button of w.buttons) element.append(place("button", button));
        return [element, () => {}];
    },

    toggle(w) {
        const box = make("input", {type: "checkbox"});
        const label = make("label", {title: w.hint}, box, make("span", {textContent: w.label}));
        const element = make("div", {className: "widget toggle"}, label);
        box.addEventListener("change", () => {
            w.value = box.checked; // What follows at once counts after it.
            say(w.id, box.checked);
        });
        return [element, () => { box.checked = w.value; }];
    },

    choice(w) {
        const select = make("select");
        const label = make("label", {textContent: w.label, title: w.hint});
        select.setAttribute("aria-label", w.label);
        const element = make("div", {className: "widget choice"}, label, select);
        select.addEventListener("change", () => say(w.id, select.value));
        const update = () => {
            const options = w.options.map((text) => make("option", {textContent: text, value: text}));
            select.replaceChildren(...options);
            select.value = w.value;
        };
        return [element, update];
    },

    text(w) {
        const label = make("span", {className: "label", textContent: w.label});
        if (!w.can_copy) {
            const value = make("span", {className: "value"});
            const element = make("div", {className: "widget text"}, label, value);
            return [element, () => { value.textContent = w.value; }];
        }
        const pre = make("pre");
        const button = make("button", {textContent: "copy"});
        button.addEventListener("click", () => {
            copy(pre);
            button.textContent = "copied";
            setTimeout(() => { button.textContent = "copy"; }, 1000);
        });
        const bar = make("div", {className: "bar"}, label, button);
        const element = make("div", {className: "widget text block"}, bar, pre);
        return [element, () => { if (pre.textContent !== w.value) pre.textContent = w.value; }];
    },

    picture(w) {
        const image = make("img", {alt: w.label, title: "click: large, and small again"});
        const [lower, upper] = [make("span"), make("span")];
        const ends = make("div", {className: "ends"}, lower, upper);
        const element = make("div", {className: "widget picture"}, image, ends);
        image.addEventListener("click", () => element.classList.toggle("large"));
        const update = () => {
            element.hidden = !w.source;
            if (w.source && image.getAttribute("src") !== w.source) image.src = w.source;
            lower.textContent = w.lower;
            upper.textContent = w.upper;
        };
        return [element, update];
    },

    item(w) {
        const state = make("span");
        const buttons = make("div", {className: "buttons"});
        const name = make("div", {className: "name"}, ...breakable(w.label));
        const detail = make("div", {className: "detail"}, ...breakable(w.detail));
        const element = make("div", {className: "widget item"}, name, state, detail, buttons);
        const update = () => {
            state.textContent = w.state;
            state.className = `state ${w.state}`;
            buttons.replaceChildren(...w.buttons.map((button) => place("button", button)));
        };
        return [element, update];
    },
};

// Makes a widget's element and keeps what changes it.
const place = (kind, fields) => {
    const widget = {...fields};
    const [element, update] = makers[kind](widget);
    element.dataset.id = widget.id ?? "";
    update();
    if (widget.id) widgets.set(widget.id, {widget, update});
    return element;
};

// Works where navigator.clipboard does not: in pages that are not of this machine.
const copy = (element) => {
    const range = document.createRange();
    range.selectNodeContents(element);
    const selection = getSelection();
    selection.removeAllRanges();
    selection.addRange(range);
    document.execCommand("copy");
    selection.removeAllRanges();
};
