(() => {
  'use strict';

  const { report, scheme, narrow, draw } = skytrace;

  const drawAll = () => Promise.all(Object.entries(report.figures).map(([id, figure]) => draw(id, figure)));

  drawAll().then(() => {
    scheme.addEventListener('change', drawAll);
    narrow.addEventListener('change', drawAll);
    document.documentElement.dataset.report = 'drawn';
  });
})();
