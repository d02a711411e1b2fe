// The page of `trisplat bench cost`: plots of any two quantities, the table, and the pictures behind every point.
import { draw } from "./plot.js";
import { QUANTITIES, group, label, quantity, written } from "./quantities.js";

const at = (id) => document.getElementById(id);
const data = JSON.parse(at("data").textContent);
const rows = data.rows.map((row, i) => ({ ...row, picture: data.pictures[i] }));
const groups = [...new Set(rows.map(group))];
let chart = null;
let order = null;
let chosen = null;

function fill(select, options, value) {
  select.replaceChildren(...options.map(([key, name]) => new Option(name, key, false, key === value)));
}

const now = () => ({
  x: at("x").value,
  y: at("y").value,
  xlog: at("xlog").checked,
  ylog: at("ylog").checked,
  color: at("color").value,
});
const visible = () => rows.filter((row) => at("group").value === "all" || group(row) === at("group").value);
const defaultOf = (row) => rows.find((other) => group(other) === group(row) && other.is_default);

/** Shows a row beside the plot and marks it in the table. */
function choose(row) {
  if (!row) return;
  chosen = row;
  at("name").textContent = label(row);
  at("drawn").src = row.picture ?? "";
  at("default").src = defaultOf(row)?.picture ?? "";
  at("photo").src = data.photo;
  const facts = QUANTITIES.map((q) => [q.name, written(row, q)]);
  const instead = row.is_default ? [] : [["default value", row.default_value]];
  const front = [["front", row.on_front ? "on it" : `beaten by ${row.beaten_by}`]];
  const more = [["buys", row.buys], ["not needed", row.skipped]].filter(([, text]) => text);
  const list = [...instead, ...facts, ...front, ...more].flatMap(([name, text]) => {
    const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
    dt.textContent = name;
    dd.textContent = text;
    return [dt, dd];
  });
  at("figures").replaceChildren(...list);
  for (const tr of at("rows").children) tr.classList.toggle("chosen", tr.row === row);
}

function table() {
  const sorted = visible();
  if (order) sorted.sort((a, b) => ((a[order.key] ?? Infinity) - (b[order.key] ?? Infinity)) * (order.down ? -1 : 1));
  const cells = (row) => [label(row), ...QUANTITIES.map((q) => written(row, q))];
  const made = sorted.map((row) => {
    const tr = document.createElement("tr");
    tr.row = row;
    tr.classList.toggle("front", row.on_front);
    tr.classList.toggle("chosen", row === chosen);
    tr.append(...cells(row).map((text) => Object.assign(document.createElement("td"), { textContent: text })));
    tr.addEventListener("click", () => choose(row));
    return tr;
  });
  at("rows").replaceChildren(...made);
}

function heads() {
  const names = [["", "setting"], ...QUANTITIES.map((q) => [q.key, q.name])];
  const made = names.map(([key, name]) => {
    const th = Object.assign(document.createElement("th"), { textContent: name });
    th.addEventListener("click", () => {
      order = key ? { key, down: order?.key === key && !order.down } : null;
      table();
    });
    return th;
  });
  at("head").replaceChildren(...made);
}

/** One sentence per group: is the default on the front? */
function says() {
  const sentences = [...new Set(visible().map(group))].map((name) => {
    const own = rows.filter((row) => group(row) === name);
    const ours = own.find((row) => row.is_default);
    const better = own.find((row) => ours && label(row) === ours.beaten_by);
    const once = ours?.runs === 1 ? " One run each: small differences may be chance." : "";
    if (!better) return `${name}: no setting beats the default.${once}`;
    const buys = better.buys ? ` The default buys ${better.buys}.` : "";
    return `${name}: the default is off the front; ${label(better)} takes ${written(better, quantity("cpu_ratio"))} of its seconds.${buys}${once}`;
  });
  at("says").textContent = sentences.join(" ");
}

function show() {
  chart?.destroy();
  chart = draw(at("chart"), visible(), now(), choose);
  table();
  says();
}

/** What is usual to look at in a group: drawings by their difference from the exact answer. */
function start() {
  const drawing = visible().every((row) => row.stage === "draw");
  at("x").value = "cpu_seconds";
  at("y").value = drawing ? "exact_rms" : "psnr";
  at("ylog").checked = false;
  at("color").value = at("group").value === "all" ? "group" : "knob";
  choose(visible().find((row) => row.is_default));
  show();
}

const { date, commit, cpu, scene } = data.rows[0] ?? {};
at("where").textContent = [data.generator, scene, cpu, date, commit && `commit ${commit}`].filter(Boolean).join(" · ");
fill(at("group"), [...groups.map((name) => [name, name]), ["all", "all stages"]], groups[0]);
fill(at("x"), QUANTITIES.map((q) => [q.key, q.name]), "cpu_seconds");
fill(at("y"), QUANTITIES.map((q) => [q.key, q.name]), "psnr");
fill(at("color"), [["knob", "option"], ["group", "stage"], ["scene", "scene"], ["on_front", "on the front"]], "knob");
heads();
at("group").addEventListener("change", start);
for (const id of ["x", "y", "xlog", "ylog", "color"]) at(id).addEventListener("change", show);
start();

/** For tests: the rows, what is plotted, and where. */
window.trisplat = {
  rows,
  plotted: () => chart.data.datasets.flatMap((set) => set.data.map((p) => label(p.row))),
  place: (name) => {
    for (const [i, set] of chart.data.datasets.entries()) {
      const j = set.data.findIndex((p) => label(p.row) === name);
      if (j >= 0) return (({ x, y }) => [x, y])(chart.getDatasetMeta(i).data[j]);
    }
    return null;
  },
  ticks: (axis) => chart.scales[axis].ticks.map((t) => t.label),
};
document.documentElement.dataset.state = "ready";
