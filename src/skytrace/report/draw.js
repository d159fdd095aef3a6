// Shared by all pages: the data, the reader's surroundings, and plotly's figures in their colours.
const skytrace = (() => {
  'use strict';

  const report = JSON.parse(document.getElementById('report-data').textContent);
  const byId = (id) => document.getElementById(id);
  const scheme = window.matchMedia('(prefers-color-scheme: dark)');
  const touch = window.matchMedia('(pointer: coarse)').matches;
  const theme = () => report.themes[scheme.matches ? 'dark' : 'light'];
  const narrow = window.matchMedia('(max-width: 45rem)');

  // The buttons are listed one by one: plotly's own choice holds one that uploads the figure.
  const settings = (buttons) => ({
    responsive: true,
    displaylogo: false,
    displayModeBar: !touch && !narrow.matches,
    modeBarButtons: [buttons],
  });
  const BUTTONS_2D = ['toImage', 'zoom2d', 'pan2d', 'resetScale2d'];
  const BUTTONS_3D = ['toImage', 'tableRotation', 'pan3d', 'zoom3d'];

  // "$ink" and its like become the reader's colours; long arrays hold numbers and camera names only.
  function coloured(value, colours) {
    if (typeof value === 'string') {
      return value.startsWith('$') && value.slice(1) in colours ? colours[value.slice(1)] : value;
    }
    if (Array.isArray(value)) {
      return value.length && typeof value[0] === 'object' ? value.map((item) => coloured(item, colours)) : value;
    }
    if (value === null || typeof value !== 'object') return value;
    return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, coloured(item, colours)]));
  }

  function draw(id, figure) {
    const { colours, template } = theme();
    const layout = { ...coloured(figure.layout, colours), template };
    if (touch && !layout.scene) layout.dragmode = false; // a finger on a plot scrolls the page
    const buttons = figure.buttons ?? (layout.scene ? BUTTONS_3D : BUTTONS_2D);
    return Plotly.react(byId(id), coloured(figure.data, colours), layout, settings(buttons));
  }

  return { report, byId, scheme, narrow, touch, theme, draw };
})();
