// What a row holds that can be plotted, and how numbers are shown.

/** 20000 as "20k", 1234567 as "1.23M", 0.5 as "0.5". */
export function short(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "-";
  const size = Math.abs(value);
  const [unit, letter] = size >= 0.9995e9 ? [1e9, "G"] : size >= 0.9995e6 ? [1e6, "M"] : size >= 9995 ? [1e3, "k"] : [1, ""];
  const scaled = value / unit;
  const digits = Math.min(5, Math.max(0, 2 - Math.floor(Math.log10(Math.max(Math.abs(scaled), 1e-4)))));
  return String(Number(scaled.toFixed(digits))) + letter;
}

/** Name in the row, what it is called, and how it is written in full. */
export const QUANTITIES = [
  { key: "cpu_seconds", name: "CPU seconds", text: (v) => v.toPrecision(3) },
  { key: "cpu_ratio", name: "CPU seconds, × default", text: (v) => v.toFixed(2) },
  { key: "wall_seconds", name: "wall seconds", text: (v) => v.toPrecision(3) },
  { key: "peak_bytes", name: "peak memory, bytes", text: short },
  { key: "bytes", name: "file, bytes", text: short },
  { key: "triangles", name: "triangles", text: short },
  { key: "psnr", name: "PSNR, dB", text: (v) => v.toFixed(3) },
  { key: "psnr_change", name: "PSNR − default, dB", text: (v) => (v < 0 ? "−" : "+") + Math.abs(v).toFixed(3) },
  { key: "ssim", name: "SSIM", text: (v) => v.toFixed(4) },
  { key: "flip", name: "FLIP", text: (v) => v.toFixed(4) },
  { key: "exact_rms", name: "difference from exact, levels", text: (v) => v.toFixed(3) },
];

/** A quantity by its name in the row. */
export const quantity = (key) => QUANTITIES.find((q) => q.key === key);

/** A row's value as text; "~" behind what is within the spread. */
export function written(row, { key, text }) {
  if (row[key] === null || row[key] === undefined) return "–";
  const within = { cpu_ratio: row.cpu_within_spread, psnr_change: row.psnr_within_spread }[key];
  return text(row[key]) + (within ? " ~" : "");
}

/** "steps=500", or "default". */
export const label = (row) => (row.is_default ? "default" : `${row.knob}=${row.value}`);
/** What is compared with each other. */
export const group = (row) => `${row.stage} (${row.input})${row.scene === "synthetic" ? "" : `, ${row.scene}`}`;
