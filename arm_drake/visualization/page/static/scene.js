// What the page does with Meshcat's scene: names beside things, a camera that stays above
// the ground and sees all on a phone, a dark background where the browser is dark, and
// clicks on links.
"use strict";

// Calls something before and after a method of Meshcat's viewer.
const beside = (viewer, name, before, after) => {
    const method = viewer[name];
    viewer[name] = function (...given) {
        before(...given);
        const result = method.apply(this, given);
        after(...given);
        return result;
    };
};
const nothing = () => {};

// ---- Names beside frames: they follow the camera ----

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

// So high at least [m].
const above = 0.02;

const keep_above_ground = (viewer) => {
    const is_seen = (...path) => {
        let node = viewer.scene_tree;
        return path.every((name) => (node = node.children[name]) && node.object.visible);
    };
    // Drawn with its lines, or as its world's file says.
    const has_ground = is_seen("Grid", "ground", "plane", "<object>")
        || is_seen("Ground", "plane", "<object>");
    // Around what it looks at, the camera is as high as the cosine of this angle says.
    const {target} = viewer.controls;
    const lowest = (above - target.y) / viewer.camera.position.distanceTo(target);
    viewer.controls.maxPolarAngle = has_ground ? Math.acos(Math.max(-1, Math.min(1, lowest))) : Math.PI;
};

// ---- A narrow window, as a phone's, shows as much from side to side as a wide one ----

const widths = new WeakMap();

const fit_width = (viewer) => {
    const {clientWidth, clientHeight} = viewer.renderer.domElement;
    const zoom = Math.min(1, clientWidth / clientHeight);
    // Another zoom may be set by Meshcat's own controls.
    if (!(zoom > 0) || zoom === (widths.get(viewer) ?? 1)) return;
    widths.set(viewer, zoom);
    viewer.camera.zoom = zoom;
    viewer.camera.updateProjectionMatrix();
    viewer.set_dirty();
};

// ---- The camera goes where a link goes ----

// Meshcat's own camera would turn if what it hangs on moved. "/Followed" says how far the
// link has gone since the camera was put somewhere; when that is done, it is deleted. A
// page that comes later hears of both, in any order, some of it before this begins.
const follow_links = (viewer) => {
    if (viewer.arm_drake_follows) return;
    viewer.arm_drake_follows = true;
    let way = [0, 0, 0];
    // The page's own y is up.
    const move = (place, [x, y, z]) => place.set(place.x + x, place.y + z, place.z - y);
    const go_to = (next) => {
        const step = next.map((number, k) => number - way[k]);
        for (const place of [viewer.camera.position, viewer.controls.target]) move(place, step);
        way = next;
    };
    const after = (name, act) => beside(viewer, name, nothing, act);
    const is_followed = (path) => path.join("/") === "Followed";
    after("set_transform", (path, matrix) => {
        if (is_followed(path)) go_to([...matrix.slice(12, 15)]);
    });
    after("delete_path", (path) => {
        if (is_followed(path)) way = [0, 0, 0];
    });
    after("set_camera_target", () => move(viewer.controls.target, way));
    after("set_property", (path, name) => {
        if (name === "position" && path.join("/") === "Cameras/default/rotated/<object>")
            move(viewer.camera.position, way);
    });
    go_to(viewer.scene_tree.find(["Followed"]).object.position.toArray());
};

// ---- What is on its way ----

// Returns the paths of objects that are to be drawn and aren't yet, as it changes.
const watch_loading = (viewer) => {
    const waiting = new Set();
    beside(viewer, "set_object_from_json", (path) => waiting.add(path.join("/")), nothing);
    beside(viewer, "set_object", nothing, (path) => waiting.delete(path.join("/")));
    return waiting;
};

// ---- The background is dark where the browser is, unless the world has its own ----

const dark = matchMedia("(prefers-color-scheme: dark)");
const ends = {top_color: [0.16, 0.19, 0.23], bottom_color: [0.05, 0.06, 0.08]};

const follow_scheme = (viewer) => {
    const path = ["Background", "<object>"];
    const {object} = viewer.scene_tree.find(path);
    const light = Object.fromEntries(Object.keys(ends).map((end) => {
        const {r, g, b} = object[end];
        return [end, [r / 255, g / 255, b / 255]];
    }));
    let is_own = true;
    const paint = () => {
        const colors = Object.entries(dark.matches ? ends : light);
        for (const [end, color] of colors) set_property.call(viewer, path, end, color);
    };
    const {set_property} = viewer;
    if (dark.matches) paint();
    dark.addEventListener("change", () => { if (is_own) paint(); });
    beside(viewer, "set_property", ([first]) => {
        if (first === "Background") is_own = false;
    }, nothing);
};

// ---- Clicks ----

// Returns the ray into the scene of a window through where the pointer is.
const ray_at = ({MeshCat: {THREE}, viewer}, {clientX, clientY}) => {
    const {left, top, width, height} = viewer.renderer.domElement.getBoundingClientRect();
    const ray = new THREE.Raycaster();
    const [right, up] = [2 * (clientX - left) / width - 1, 1 - 2 * (clientY - top) / height];
    ray.setFromCamera({x: right, y: up}, viewer.camera);
    return ray;
};

// Returns what is seen along a ray, {path, point}, or nothing.
const hit_by = ({viewer}, ray) => {
    const drake = viewer.scene_tree.find(["drake"]);
    for (const {object, point} of ray.intersectObject(drake.object, true)) {
        const above = new Set();
        for (let one = object; one; one = one.parent) above.add(one);
        if (!object.isMesh || [...above].some((one) => !one.visible)) continue;
        const path = ["drake"];
        for (let node = drake; node;) {
            const found = Object.entries(node.children).find(([, child]) => above.has(child.object));
            if (found) path.push(found[0]);
            node = found && found[1];
        }
        return {path: path.join("/"), point};
    }
    return null;
};

// Tells what a click, not a drag, has hit in the scene of a window.
const listen_to_clicks = (window, tell) => {
    const canvas = window.viewer.renderer.domElement;
    let start = null;
    canvas.addEventListener("pointerdown", ({button, clientX, clientY}) => {
        start = button ? null : [clientX, clientY];
    });
    // What turns the camera takes the rest of a drag for itself.
    window.addEventListener("pointerup", (event) => {
        const {clientX, clientY} = event;
        const is_click = start && Math.hypot(clientX - start[0], clientY - start[1]) < 4;
        start = null;
        if (!is_click) return;
        const hit = hit_by(window, ray_at(window, event));
        if (hit) tell(hit.path);
    });
};

// Tells of drags that begin on something, where `is_on`, instead of turning the camera:
// where they began and are now, in Drake's world, in the plane that faces the camera.
const listen_to_drags = (window, is_on, tell, release) => {
    const {MeshCat: {THREE}, viewer} = window;
    let drag = null;
    window.addEventListener("pointerdown", (event) => {
        if (event.button || event.target !== viewer.renderer.domElement || !is_on(event)) return;
        const hit = hit_by(window, ray_at(window, event));
        if (!hit) return;
        event.stopPropagation(); // Else the camera turns.
        const facing = viewer.camera.getWorldDirection(new THREE.Vector3());
        const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(facing, hit.point);
        const drake = viewer.scene_tree.find(["drake"]).object;
        const local = (point) => drake.worldToLocal(point.clone()).toArray();
        drag = {plane, local, path: hit.path, from: local(hit.point)};
    }, true);
    window.addEventListener("pointermove", (event) => {
        const point = drag && ray_at(window, event).ray.intersectPlane(drag.plane, new THREE.Vector3());
        if (!point) return;
        event.stopPropagation();
        tell({path: drag.path, from: drag.from, to: drag.local(point)});
    }, true);
    for (const end of ["pointerup", "pointercancel"])
        window.addEventListener(end, () => {
            if (drag) release();
            drag = null;
        }, true);
};
