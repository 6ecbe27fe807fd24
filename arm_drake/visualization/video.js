// What a Meshcat page does for a film; screenshot.js is there before it. z is up in all
// arguments.
window.arm_drake_film = (() => {
    // After that the pictures so far are handed over: whoever waits may give up [ms].
    const patience = 250;

    // Directions to all sides, about 23 degrees from each to the next.
    const to_all_sides = [];
    for (let i = -2; i <= 2; ++i)
        for (let j = -2; j <= 2; ++j)
            for (const s of [-2, 2])
                to_all_sides.push([i, j, s], [i, s, j], [s, i, j]);

    const seek = (time) => {
        viewer.animator.seek(time);
        viewer.scene.updateMatrixWorld(true);
    };

    // Returns the duration of the recording [s], null if there is none; it stands still
    // from now on, and the page itself draws no more.
    const start = () => {
        if (!viewer.animator.actions.length) return null;
        viewer.animator.pause();
        viewer.animate = () => {};
        return viewer.animator.duration;
    };

    // Returns the vertices of a mesh that are the farthest to some side.
    const outermost = (position) => {
        const found = to_all_sides.map(() => ({reach: -Infinity, vertex: null}));
        for (let i = 0; i < position.count; ++i) {
            const x = position.getX(i), y = position.getY(i), z = position.getZ(i);
            to_all_sides.forEach(([a, b, c], k) => {
                const reach = a * x + b * y + c * z;
                if (reach > found[k].reach) found[k] = {reach, vertex: [x, y, z]};
            });
        }
        return [...new Set(found.map(({vertex}) => String(vertex)))]
            .map((text) => text.split(",").map(Number));
    };

    // Returns the times at which something is farther in a direction than ever.
    const find_extreme_times = (paths, directions, times) => {
        const meshes = [];
        const visit = (object) => {
            if (!object.visible) return;
            const position = object.isMesh && object.geometry.attributes.position;
            if (position && position.count)
                meshes.push({object, vertices: outermost(position)});
            object.children.forEach(visit);
        };
        for (const path of paths) visit(arm_drake.find(...path));
        const found = directions.map(() => ({reach: -Infinity, time: null}));
        for (const time of times) {
            seek(time);
            for (const {object, vertices} of meshes) {
                const m = object.matrixWorld.elements;
                directions.forEach(([a, b, c], k) => {
                    const row = [a, c, -b];  // The page's own y is up.
                    const [x, y, z, w] = [0, 1, 2, 3].map((j) => row[0] * m[4 * j]
                        + row[1] * m[4 * j + 1] + row[2] * m[4 * j + 2]);
                    for (const v of vertices) {
                        const reach = x * v[0] + y * v[1] + z * v[2] + w;
                        if (reach > found[k].reach) found[k] = {reach, time};
                    }
                });
            }
        }
        return [...new Set(found.map(({time}) => time))].filter((t) => t !== null);
    };

    // Returns where everything is, alike if no picture could show a difference.
    const arrangement = () => {
        const parts = [];
        viewer.scene.traverseVisible((object) => {
            if (object.isMesh)
                parts.push(...object.matrixWorld.elements.map((e) => e.toFixed(6)));
        });
        return parts.join();
    };
    let shown = null, picture = null;

    // Returns JPEG files of the first of some times, at least of one.
    const take_pictures = (times) => {
        const pictures = [];
        const start = performance.now();
        for (const time of times) {
            seek(time);
            const now = arrangement();
            if (now !== shown) {
                viewer.render();
                // In the same task, or the picture is gone.
                picture = viewer.renderer.domElement.toDataURL("image/jpeg", 0.95);
                shown = now;
            }
            pictures.push(picture);
            if (performance.now() - start > patience) break;
        }
        return pictures;
    };

    return {start, seek, find_extreme_times, take_pictures};
})();
