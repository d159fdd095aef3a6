(() => {
  'use strict';

  const { report, byId, scheme, narrow, theme, draw } = skytrace;

  // ---- the path and the moment shown ----

  const path = report.path;
  const samples = path.time.flatMap((time, row) => (time === null ? [] : [row])); // rows that are not gaps
  let shown = 0; // index into samples

  const short = (value, digits = 4) => {
    if (value === null || value === undefined) return '–';
    const text = Math.abs(value) >= 1e4 ? value.toFixed(0) : String(Number(value.toPrecision(digits)));
    return text.replace('-', '−');
  };

  const position = (row) => {
    const values = [path.x[row], path.y[row], path.z[row]].map((value) => value.toFixed(report.decimals));
    return `${values.join(', ').replaceAll('-', '−')} ${report.unit}`;
  };

  const seenBy = (time) =>
    report.cameras.filter((camera) =>
      camera.seen.some(([begin, end]) => begin - report.support <= time && time <= end + report.support));

  function nearestSample(time) {
    let low = 0;
    let high = samples.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (path.time[samples[middle]] < time) low = middle + 1;
      else high = middle;
    }
    const before = Math.max(low - 1, 0);
    return time - path.time[samples[before]] < path.time[samples[low]] - time ? before : low;
  }

  // ---- 3D ----

  // The eye steps back where the figure is narrow, so that its sides stay in view.
  function viewOf(name) {
    const view = structuredClone(report.views[name]);
    const { clientWidth, clientHeight } = byId('scene');
    const back = Math.min(Math.max((1.2 * clientHeight) / Math.max(clientWidth, 1), 1), 2.5);
    for (const axis of ['x', 'y', 'z']) view.eye[axis] *= back;
    return view;
  }

  const traceOf = (meta) => report.scene.data.findIndex((trace) => trace.meta === meta);

  function hoverTexts() {
    return path.time.map((time, row) => time === null ? '' :
      `${time.toFixed(2)} s, segment ${path.segment[row]}<br>` +
      `${position(row)}<br>` +
      `${short(path.speed[row], 3)} ${report.unit}/s` +
      (path.sigma[row] === null ? '' : `, ± ${short(path.sigma[row], 2)} ${report.unit}`) +
      `<br>${path.cameras[row]} cameras` +
      (path.error?.[row] == null ? '' : `, error ${short(path.error[row], 3)} cm`));
  }

  function targetTraces() {
    const row = samples[shown];
    const line = report.scene.data[traceOf('path')];
    const at = ['x', 'y', 'z'].map((axis) => line[axis][row]);
    const rays = [[], [], []];
    for (const camera of seenBy(path.time[row])) {
      at.forEach((value, axis) => rays[axis].push(camera.centre[axis], value, null));
    }
    return { at, rays };
  }

  function sceneFigure() {
    const choice = report.colours.find(({ key }) => key === byId('colour').value);
    const data = report.scene.data.map((trace) => ({ ...trace }));
    const layout = structuredClone(report.scene.layout);
    layout.scene.camera = byId('scene').layout?.scene?.camera ?? viewOf('overview');
    const line = data[traceOf('path')];
    if (samples.length) {
      line.line = { ...line.line, color: path[choice.key].map((v) => v ?? choice.min), coloraxis: 'coloraxis' };
      line.text = hoverTexts();
      line.hoverinfo = 'text';
      const { at, rays } = targetTraces();
      Object.assign(data[traceOf('target')], { x: [at[0]], y: [at[1]], z: [at[2]] });
      Object.assign(data[traceOf('sight')], { x: rays[0], y: rays[1], z: rays[2] });
      layout.coloraxis = {
        cmin: choice.min,
        cmax: choice.max,
        colorscale: theme().scale,
        colorbar: {
          title: { text: choice.label, side: 'top' },
          orientation: 'h', thickness: 10, x: 0.5, y: 1, yanchor: 'top', len: narrow.matches ? 0.9 : 0.5,
          ...(choice.key === 'cameras' ? { dtick: 1 } : {}),
        },
      };
    }
    return { data, layout };
  }

  const drawScene = () => draw('scene', canDraw3d ? sceneFigure() : planFigure(sceneFigure()));

  const canDraw3d = (() => {
    const context = document.createElement('canvas').getContext('webgl');
    if (context) context.getExtension('WEBGL_lose_context')?.loseContext();
    return Boolean(context);
  })();

  // Without WebGL the same traces are drawn as seen from above.
  function planFigure(figure) {
    const data = figure.data.map(({ z, textposition, ...trace }) => {
      const flat = { ...trace, type: 'scatter' };
      if (trace.meta === 'path' && trace.line.coloraxis) {
        flat.mode = 'markers';
        flat.marker = { size: 4, color: trace.line.color, coloraxis: 'coloraxis' };
        delete flat.line;
      }
      return flat;
    });
    const { scene, ...layout } = figure.layout;
    return {
      data,
      layout: {
        ...layout,
        margin: { l: 8, r: 8, t: 8, b: 8 },
        hovermode: 'closest',
        xaxis: scene.xaxis,
        yaxis: { ...scene.yaxis, scaleanchor: 'x', domain: [0, 0.86] },
      },
    };
  }

  function moveTarget() {
    const { at, rays } = targetTraces();
    const update = { x: [[at[0]], rays[0]], y: [[at[1]], rays[1]] };
    if (canDraw3d) update.z = [[at[2]], rays[2]];
    Plotly.restyle(byId('scene'), update, [traceOf('target'), traceOf('sight')]);
  }

  // ---- the slider ----

  const slider = byId('moment');

  function writeReadout() {
    const row = samples[shown];
    const time = path.time[row];
    const { unit } = report;
    const names = seenBy(time).map((camera) => camera.id).join(', ') || 'no camera';
    byId('at-time').textContent = `${time.toFixed(2)} s`;
    byId('at-position').textContent = position(row);
    byId('at-speed').textContent = `${short(path.speed[row], 3)} ${unit}/s`;
    byId('at-sigma').textContent = path.sigma[row] === null ? 'unknown' : `± ${short(path.sigma[row], 2)} ${unit}`;
    byId('at-cameras').textContent = names;
    slider.setAttribute('aria-valuetext', `${time.toFixed(1)} seconds, seen by ${names}`);
  }

  const cursor = (axes) => ({
    type: 'line', xref: 'x', yref: axes, y0: 0, y1: 1,
    x0: path.time[samples[shown]], x1: path.time[samples[shown]],
    line: { width: 1.5, color: theme().colours.target },
  });

  const cursorIds = ['timeline', 'errors-time', ...(report.truth ? ['truth-error'] : [])];

  // Where the chosen camera sees the target at the moment shown.
  const chosenCamera = () => report.cameras[Number(byId('camera').value)];
  const nowInImage = ({ projected }) => {
    const row = samples[shown];
    return { x: [[projected.x[row] ?? null]], y: [[projected.y[row] ?? null]] };
  };

  let waiting = false;
  function show(index) {
    shown = Math.min(Math.max(index, 0), samples.length - 1);
    slider.value = shown;
    writeReadout();
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      moveTarget();
      for (const id of cursorIds) Plotly.relayout(byId(id), { shapes: [cursor('paper')] });
      const image = byId('errors-image');
      Plotly.restyle(image, nowInImage(chosenCamera()), [image.data.length - 1]);
    });
  }

  let playing = null;
  let playedTime = 0;

  function jump(index) {
    show(index);
    playedTime = path.time[samples[shown]];
  }

  function play() {
    const end = samples.length - 1;
    let last = performance.now();
    jump(shown === end ? 0 : shown);
    const step = (now) => {
      playedTime += ((now - last) / 1000) * Number(byId('pace').value);
      last = now;
      let next = shown;
      while (next < end && path.time[samples[next + 1]] <= playedTime) next += 1;
      const endsSegment = next < end && samples[next + 1] - samples[next] > 1;
      if (endsSegment && next === shown) jump(next + 1);
      else if (next !== shown) show(next);
      if (shown === end) stop();
      else playing = requestAnimationFrame(step);
    };
    playing = requestAnimationFrame(step);
    byId('play').textContent = '❚❚';
    byId('play').setAttribute('aria-label', 'Pause');
  }

  function stop() {
    cancelAnimationFrame(playing);
    playing = null;
    byId('play').textContent = '▶';
    byId('play').setAttribute('aria-label', 'Play');
  }

  // ---- the other figures ----

  const withCursor = (figure) => samples.length ?
    { ...figure, layout: { ...figure.layout, shapes: [cursor('paper')] } } : figure;

  const drawTimeline = () => draw('timeline', withCursor(report.timeline));

  function imageFigure(camera) {
    const { data, layout } = camera.figures.image;
    if (!samples.length) return { data, layout };
    const line = {
      type: 'scatter', mode: 'lines', name: 'path, projected', visible: 'legendonly', hoverinfo: 'skip',
      ...camera.projected, line: { width: 1, color: '$muted' },
    };
    const { x, y } = nowInImage(camera);
    const ring = {
      type: 'scatter', mode: 'markers', meta: 'now', name: 'target now', x: x[0], y: y[0], hoverinfo: 'skip',
      marker: { size: 16, symbol: 'circle-open', color: '$target', line: { width: 3, color: '$target' } },
    };
    return { data: [...data, line, ring], layout };
  }

  const drawTruth = () => report.truth && draw('truth-error', withCursor(report.truth.error));

  const drawClocks = () =>
    Promise.all(Object.entries(report.clocks).map(([name, figure]) => draw(`clock-${name}`, figure)));

  function drawErrors() {
    const camera = chosenCamera();
    draw('errors-time', withCursor(camera.figures.time));
    draw('errors-histogram', camera.figures.histogram);
    draw('errors-image', imageFigure(camera));
    byId('errors-shown').textContent = camera.shown < camera.used ?
      `Shown: ${camera.shown} of ${camera.used} detections, evenly chosen; the median is of all.` : '';
  }

  async function drawAll() {
    await Promise.all([drawScene(), drawTimeline()]);
    await Promise.all([drawTruth(), drawClocks()]);
    drawErrors();
  }

  function connect() {
    if (report.truth) {
      const error = report.colours.find(({ key }) => key === 'error');
      if (error) byId('colour').add(new Option(error.label, error.key));
      byId('scene-caption').append(' The grey line is the true path.');
    }
    slider.max = Math.max(samples.length - 1, 0);
    if (samples.length) {
      slider.addEventListener('input', () => jump(Number(slider.value)));
      byId('play').addEventListener('click', () => (playing === null ? play() : stop()));
      const jumpToTime = ({ points }) => jump(nearestSample(points[0].x));
      for (const id of cursorIds) byId(id).on('plotly_click', jumpToTime);
      byId('scene').on('plotly_click', ({ points }) => {
        const row = points[0].data.meta === 'path' ? samples.indexOf(points[0].pointNumber) : -1;
        if (row >= 0) jump(row);
      });
      writeReadout();
    } else {
      for (const id of ['moment', 'play', 'pace', 'colour']) byId(id).disabled = true;
    }
    byId('colour').addEventListener('change', drawScene);
    byId('camera').addEventListener('change', drawErrors);
    if (!canDraw3d) byId('scene-caption').textContent = 'Seen from above: this browser offers no WebGL for the 3D picture.';
    for (const button of document.querySelectorAll('[data-view]')) {
      button.hidden = !canDraw3d;
      button.addEventListener('click', () =>
        Plotly.relayout(byId('scene'), { 'scene.camera': viewOf(button.dataset.view) }));
    }
    scheme.addEventListener('change', drawAll);
    narrow.addEventListener('change', drawScene);
  }

  drawAll().then(() => {
    connect();
    document.documentElement.dataset.report = 'drawn';
  });
})();
