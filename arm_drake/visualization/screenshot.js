// What a Meshcat page does for a screenshot. Its own y is up, z is up in all arguments.
window.arm_drake = (() => {
    // Objects that the page has been told to draw and hasn't drawn yet, and whether it
    // has drawn the last change: that something called `last_change` is deleted.
    const waiting = new Set();
    const last_change = "arm_drake_last_change";
    let is_complete = false;

    // Nobody sees the page: frames for each change cost far more than the picture.
    window.requestAnimationFrame = () => 0;

    let viewer;
    Object.defineProperty(window, "viewer", {
        get: () => viewer,
        set: (made) => {
            viewer = made;
            const {set_object, set_object_from_json, delete_path} = made;
            made.set_object_from_json = function (path, data) {
                waiting.add(path.join("/"));
                return set_object_from_json.call(this, path, data);
            };
            made.set_object = function (path, object) {
                set_object.call(this, path, object);
                waiting.delete(path.join("/"));
            };
            made.delete_path = function (path) {
                if (path[path.length - 1] === last_change) is_complete = true;
                else delete_path.call(this, path);
            };
        },
    });

    const find = (...path) => viewer.scene_tree.find(path).object;
    const place = (vector, [x, y, z]) => vector.set(x, z, -y);

    // Returns whether the page has drawn everything, and what it hasn't drawn yet.
    const progress = () => [is_complete, [...waiting]];

    // Returns the farthest drawn point in each direction, none where nothing is drawn.
    const find_extremes = (paths, directions) => {
        const found = directions.map(() => ({reach: -Infinity, point: null}));
        const visit = (object) => {
            if (!object.visible) return;
            const position = object.isMesh && object.geometry.attributes.position;
            const m = object.matrixWorld.elements;
            for (let i = 0; position && i < position.count; ++i) {
                const x = position.getX(i), y = position.getY(i), z = position.getZ(i);
                const px = m[0] * x + m[4] * y + m[8] * z + m[12];
                const py = m[1] * x + m[5] * y + m[9] * z + m[13];
                const pz = m[2] * x + m[6] * y + m[10] * z + m[14];
                directions.forEach(([a, b, c], k) => {
                    const reach = a * px - b * pz + c * py;
                    if (reach > found[k].reach)
                        found[k] = {reach, point: [px, -pz, py]};
                });
            }
            object.children.forEach(visit);
        };
        viewer.scene.updateMatrixWorld(true);
        for (const path of paths) visit(find(...path));
        return found.map(({point}) => point).filter((point) => point !== null);
    };

    // Makes camera, lamps and grid suit what is seen, once.
    // scale: size of what is seen, as a multiple of what Meshcat's lamps are made for.
    // grid: size of the ground's lines, which are 1 m apart at 1.
    const set_up = ({eye, target, field_of_view, scale, grid, width, height}) => {
        const {camera, controls} = viewer;
        const to_eye = eye.map((e, i) => e - target[i]);
        const distance = Math.hypot(...to_eye);
        camera.fov = field_of_view;
        camera.near = 0.01 * distance;
        camera.far = 100 * distance;
        place(camera.position, eye);
        place(controls.target, target);
        for (const name of ["PointLightNegativeX", "PointLightPositiveX"]) {
            const lamp = find("Lights", name, "<object>");
            const {x, y, z} = lamp.position;
            lamp.position.set(
                scale * x + target[0], scale * y + target[1], scale * z + target[2]);
            // As bright as it is in the middle; three.js limits what is near a lamp.
            lamp.intensity *= 0.6 / (x * x + y * y + z * z);
            lamp.decay = lamp.distance = 0;
        }
        // The lamp that is infinitely far away stands behind the camera, to its left.
        const sun = find("Lights", "FillLight", "<object>");
        const [x, y, z] = to_eye;
        sun.position.set(0.8 * x + 0.6 * y, 0.8 * y - 0.6 * x, z + 0.3 * distance);
        sun.position.setLength(distance).add({x: target[0], y: target[1], z: target[2]});
        place(sun.target.position, target);
        sun.target.updateMatrixWorld();
        sun.intensity = 1.2;
        Object.assign(sun.shadow.camera, {near: 0.01 * distance, far: 4 * distance});
        for (const [side, sign] of [["left", -1], ["right", 1], ["bottom", -1], ["top", 1]])
            sun.shadow.camera[side] = sign * distance;
        sun.shadow.camera.updateProjectionMatrix();
        const ground = find("Grid");
        ground.scale.setScalar(grid);
        ground.position.set(
            grid * Math.round(target[0] / grid), grid * Math.round(target[1] / grid), 0);
        find("Ground").scale.z = grid;
        // As on the page: shorter for what is small, never longer.
        find("Axes").scale.setScalar(Math.min(grid, 1));
        viewer.set_3d_pane_size(width, height);
    };

    return {progress, find_extremes, set_up, find};
})();
