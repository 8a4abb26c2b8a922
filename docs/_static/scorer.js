// Guides come before the pages of modules, and those before the records of the project.
var Scorer = {
  score: ([docname, title, anchor, descr, score]) =>
    score - (docname.startsWith("docs/api/") ? 20 : 0) - (/CHANGELOG|benchmarks|decisions|docs.log|reliability/.test(docname) ? 12 : 0),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: {0: 15, 1: 5, 2: -5},
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
