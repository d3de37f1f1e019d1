// The page of one run.
const detail = (record, all) => {
  const scene = all.scenes.indexOf(record.scene);
  const about = { map: all.maps[scene], problem: all.problems[scene], note: all.note };
  return steps(record, about, all.prompts);
};
start();
