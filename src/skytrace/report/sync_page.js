(() => {
  'use strict';

  const { report, byId, scheme, narrow, draw } = skytrace;
  const { pairs } = report;

  // ---- the graph of cameras ----

  const graph = () => report.graph[narrow.matches ? 'upright' : 'wide'];
  const PIXELS_PER_UNIT = 88;
  const LEGEND_PX = 60;

  function drawGraph() {
    const figure = graph();
    const [width, height] = figure.size;
    const unit = Math.min(PIXELS_PER_UNIT, byId('graph').clientWidth / width);
    return draw('graph', { ...figure, layout: { ...figure.layout, height: Math.round(unit * height) + LEGEND_PX } });
  }

  const traceOf = (meta) => graph().data.findIndex((trace) => trace.meta === meta);

  function markPair(pair) {
    const [x0, y0, x1, y1] = pair.edge === null ? [] : graph().ends[pair.edge];
    const update = pair.edge === null ? { x: [[]], y: [[]] } : { x: [[x0, x1]], y: [[y0, y1]] };
    return Plotly.restyle(byId('graph'), update, [traceOf('selected')]);
  }

  // ---- one pair ----

  let shown = report.start;

  async function drawPair() {
    const pair = pairs[shown];
    byId('pair').value = shown;
    byId('previous').disabled = shown === 0;
    byId('next').disabled = shown === pairs.length - 1;
    byId('pair-words').textContent = pair.words.join(' ');
    byId('score-figure').hidden = pair.score === null;
    byId('error-figures').hidden = pair.errors === null;
    for (const id of ['zoom-all', 'zoom-chosen']) byId(id).disabled = pair.score === null || pair.zoom === null;
    await markPair(pair);
    if (pair.score !== null) await draw('score', pair.score);
    if (pair.errors !== null) {
      await draw('errors-histogram', pair.errors.histogram);
      await draw('errors-time', pair.errors.time);
    }
  }

  function choose(index) {
    shown = Math.min(Math.max(index, 0), pairs.length - 1);
    return drawPair();
  }

  function zoom(range) {
    Plotly.relayout(byId('score'), range ? { 'xaxis.range': [...range] } : { 'xaxis.autorange': true });
  }

  // ---- all of it ----

  async function drawAll() {
    await drawGraph();
    await Promise.all(report.clocks.map((figure, k) => draw(`clock-${k}`, figure)));
    if (pairs.length) await drawPair();
  }

  function connect() {
    scheme.addEventListener('change', drawAll);
    narrow.addEventListener('change', drawAll);
    if (!pairs.length) return;
    byId('pair').addEventListener('change', () => choose(Number(byId('pair').value)));
    byId('previous').addEventListener('click', () => choose(shown - 1));
    byId('next').addEventListener('click', () => choose(shown + 1));
    byId('zoom-all').addEventListener('click', () => zoom(null));
    byId('zoom-chosen').addEventListener('click', () => zoom(pairs[shown].zoom));
    const lead = (edge) => {
      choose(pairs.findIndex((pair) => pair.edge === edge));
      byId('pair-title').scrollIntoView({ block: 'start' });
      byId('pair-title').focus({ preventScroll: true });
    };
    byId('graph').on('plotly_click', ({ points: [point] }) => {
      if (point.data.meta === 'pairs') lead(point.pointNumber);
    });
    for (const link of document.querySelectorAll('[data-pair]')) {
      link.addEventListener('click', (event) => {
        event.preventDefault();
        lead(Number(link.dataset.pair));
      });
    }
  }

  drawAll().then(() => {
    connect();
    document.documentElement.dataset.report = 'drawn';
  });
})();
