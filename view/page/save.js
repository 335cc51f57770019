// What can be taken away from the page: the scene, pictures, a film, a table.
import { csvOf, tomlOf } from "./scene.js";

export function hand(name, blob) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob); link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  return name;
}
const fileName = (page, ending) => `${(page.say(page.title) || "kaju").replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "") || "kaju"}.${ending}`;

export const saveScene = (page) => hand(fileName(page, "toml"), new Blob([tomlOf(page.scene, page.cells)], { type: "text/plain" }));
export const saveTable = (page) => hand(fileName(page, "csv"), new Blob([csvOf(page)], { type: "text/csv" }));

function onPaper(page) {                       // the picture on its background
  const { canvas, inks } = page, sheet = document.createElement("canvas");
  page.draw();
  sheet.width = canvas.width; sheet.height = canvas.height;
  const ctx = sheet.getContext("2d");
  ctx.fillStyle = inks.paper; ctx.fillRect(0, 0, sheet.width, sheet.height);
  ctx.drawImage(canvas, 0, 0);
  return sheet;
}

export const savePng = async (page) => hand(fileName(page, "png"), await new Promise((done) => onPaper(page).toBlob(done, "image/png")));

/** The picture as an SVG: cells as polygons while they are few, else as an image inside. */
export const saveSvg = (page) => hand(fileName(page, "svg"), new Blob([svgOf(page)], { type: "image/svg+xml" }));
export function svgOf(page) {
  const { canvas, inks } = page, w = canvas.clientWidth, h = canvas.clientHeight, polygons = page.polygons();
  const head = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${w} ${h}" width="${w}" height="${h}"><rect width="${w}" height="${h}" fill="${inks.paper}"/>`;
  if (!polygons) return `${head}<image href="${onPaper(page).toDataURL("image/png")}" width="${w}" height="${h}"/></svg>`;
  const shape = ({ points, fill }) => `<polygon points="${points.map((p) => p.map((v) => v.toFixed(2)).join(",")).join(" ")}" fill="${fill}"/>`;
  return `${head}<g stroke="${inks.paper}" stroke-width="0.6">${polygons.map(shape).join("")}</g></svg>`;
}

/** Play from the start to the end and record the picture. */
export async function saveFilm(page) {
  const kind = ["video/webm;codecs=vp9", "video/webm"].find((type) => globalThis.MediaRecorder?.isTypeSupported(type));
  if (!kind) throw new Error("MediaRecorder");
  const sheet = onPaper(page), recorder = new MediaRecorder(sheet.captureStream(30), { mimeType: kind, videoBitsPerSecond: 4e6 });
  let patience = 100;
  const pieces = [], ctx = sheet.getContext("2d"), stopped = new Promise((done) => { recorder.onstop = done; });
  recorder.ondataavailable = (event) => pieces.push(event.data);
  const seconds = (part) => new Promise((done) => setTimeout(done, 1000 * part)), picture = () => { ctx.fillStyle = page.inks.paper; ctx.fillRect(0, 0, sheet.width, sheet.height); ctx.drawImage(page.canvas, 0, 0); };
  recorder.start(100);
  for (let g = 0; g <= page.run.generation; g++) {
    page.goTo(g); page.draw(); picture();
    await seconds(1 / Math.max(4, page.look.speed));
  }
  do { picture(); await seconds(0.4); } while (pieces.reduce((sum, { size }) => sum + size, 0) < 500 && --patience);   // a busy machine encodes late
  recorder.stop();
  await stopped;
  return hand(fileName(page, "webm"), new Blob(pieces, { type: "video/webm" }));
}
