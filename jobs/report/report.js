// The page of one run.
const prepare = (all) => {
  all.about = scenesOf(all.scenery);
};
const detail = (record, all, lines) => steps(record, all.about(record.scene), all.prompts, lines);
start();
