// The verdict on a run (tools/run_verdict.h) in an element of any page.
(function () {
  'use strict';
  const Lamina = (window.Lamina = window.Lamina || {});
  const kTones = {good: 'good', doubtful: 'warn', wrong: 'bad'};

  // {verdict, reasons, hint}; of anything else, nothing is shown.
  Lamina.showVerdict = function (element, verdict) {
    const known = verdict && Object.hasOwn(kTones, verdict.verdict);
    element.textContent = !known ? '–' : verdict.reasons.length === 0 ? verdict.verdict :
        verdict.verdict + ': ' + verdict.reasons.join('; ') + '. ' + verdict.hint;
    element.dataset.tone = known ? kTones[verdict.verdict] : '';
  };
})();
