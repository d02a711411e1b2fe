// The plot: a dot per setting, coloured by option or scene.
import { Chart, Legend, LinearScale, LogarithmicScale, PointElement, ScatterController, Tooltip } from "chart.js";
import { group, label, quantity, short, written } from "./quantities.js";

Chart.register(Legend, LinearScale, LogarithmicScale, PointElement, ScatterController, Tooltip);

const COLORS = [
  "#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#e08030", "#777777", "#2a9d8f", "#8d6a9f",
  "#b5651d", "#5b8c5a", "#c2185b", "#3949ab", "#9e9d24", "#00838f", "#6d4c41", "#f06292", "#7cb342", "#546e7a",
];

const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Scales of an axis. */
function axis(key, log) {
  return {
    type: log ? "logarithmic" : "linear",
    title: { display: true, text: quantity(key).name, color: ink("--ink") },
    grace: log ? 0 : "6%",
    ticks: { color: ink("--dim"), callback: (value) => short(value), maxTicksLimit: 9, autoSkip: true, autoSkipPadding: 14, maxRotation: 0 },
    grid: { color: ink("--line") },
  };
}

/** The rows that an axis can show. */
const shown = (row, key, log) => Number.isFinite(row[key]) && (!log || row[key] > 0);

/** One list of dots per colour. */
export function datasets(rows, { x, y, xlog, ylog, color }) {
  const drawn = rows.filter((row) => shown(row, x, xlog) && shown(row, y, ylog));
  const names = [...new Set(drawn.map((row) => String(color === "group" ? group(row) : row[color])))];
  return names.map((name, i) => {
    const own = drawn.filter((row) => String(color === "group" ? group(row) : row[color]) === name);
    const paint = COLORS[i % COLORS.length];
    return {
      label: name,
      data: own.map((row) => ({ x: row[x], y: row[y], row })),
      borderColor: paint,
      backgroundColor: paint,
      pointBackgroundColor: own.map((row) => (row.on_front ? paint : "transparent")),
      pointStyle: own.map((row) => (row.is_default ? "rect" : "circle")),
      pointRadius: own.map((row) => (row.is_default ? 8 : 5)),
      pointBorderWidth: 2,
      pointHoverRadius: 9,
      hitRadius: 6,
    };
  });
}

/** Draws on a canvas; `onChoose` gets the row that is pointed at. */
export function draw(canvas, rows, options, onChoose) {
  const tip = ({ raw: { row } }) => [
    label(row),
    `${quantity(options.x).name}: ${written(row, quantity(options.x))}`,
    `${quantity(options.y).name}: ${written(row, quantity(options.y))}`,
  ];
  return new Chart(canvas, {
    type: "scatter",
    data: { datasets: datasets(rows, options) },
    options: {
      animation: false,
      maintainAspectRatio: false,
      scales: { x: axis(options.x, options.xlog), y: axis(options.y, options.ylog) },
      onHover: (_, [hit], chart) => hit && onChoose(chart.data.datasets[hit.datasetIndex].data[hit.index].row),
      plugins: {
        legend: { position: "bottom", labels: { color: ink("--ink"), boxWidth: 10, usePointStyle: true, pointStyle: "circle" } },
        tooltip: { callbacks: { label: tip } },
      },
    },
  });
}
