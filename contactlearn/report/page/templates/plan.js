// A plan: its one figure, which live.js has in its list.
async function startPlan() {
  await library();
  listen();
  attend();
}

startPlan();
