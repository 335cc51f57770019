// Words and numbers as readers see them. The words stand in words.json: a language is one more
// entry there, {n} is filled in, {n|agent|agents} with its noun.
import WORDS from "./words.json" with { type: "json" };

export const LANGUAGES = { en: "English", de: "Deutsch", ja: "日本語" };
/** The language that a reader chose last, on any page; where a browser keeps nothing, none. */
export const chosenLanguage = (now) => { try { if (now) localStorage.setItem("kaju:language", now); return localStorage.getItem("kaju:language"); } catch { return null; } };

let comma = false;                             // decimal, as German writes it
export const local = (number) => (comma ? number.replaceAll(".", ",") : number);
export const roundDown = (x) => { const p = 10 ** Math.floor(Math.log10(x) + 1e-12); return Number((p * [5, 2, 1].find((d) => d * p <= x * (1 + 1e-12))).toPrecision(1)); };   // to 1, 2, 5, 10 ...
export const largest = (values) => values.reduce((top, v) => (Math.abs(v) > top ? Math.abs(v) : top), 0);   // by size, of those that are numbers

export const say = (language) => {
  comma = language === "de";
  return (key, values = {}) => {
    const text = WORDS[language]?.[key] ?? WORDS.en[key] ?? values.otherwise;
    if (text === undefined) throw new Error(`no word for ${key}`);
    return text.replace(/\{(\w+)(?:\|(.*?)\|(.*?))?\}/g, (_, name, one, more) => `${values[name]}${more ? ` ${String(values[name]) === "1" ? one : more}` : ""}`);
  };
};

// ------------------------------------------------------------------------------------ numbers

/** What rounding left just below a half goes up. */
export const halvesUp = (x) => x * (1 + 1e-12);
/** A number with so many significant digits, as Python's format code "g" writes it. */
export function general(x, digits) {
  if (x === 0) return "0";
  const [mantissa, exponent] = halvesUp(x).toExponential(digits - 1).split("e"), e = Number(exponent);
  const plain = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);
  if (e < -4 || e >= digits) return local(`${plain(mantissa)}e${e < 0 ? "-" : "+"}${String(Math.abs(e)).padStart(2, "0")}`);
  return local(plain(halvesUp(x).toFixed(Math.max(0, digits - 1 - e))));
}

const PREFIXES = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"], [1e-12, "p"]];

/** A factor and its prefix that make a number short; a bare number and % have none. */
export const prefixOf = (size, unit) => (unit && unit !== "%" ? PREFIXES.find(([f]) => size >= 0.99995 * f) ?? PREFIXES.at(-1) : [1, ""]);

/** Four digits and a unit that fits, or that of the `largest` beside it unless they are far apart, and then of small ones nothing finer than the fifth digit of that: 12.88 N, 3.2 nm, 206 GPa. */
export function quantity(v, unit, largest = 0) {
  if (!Number.isFinite(v)) return "–";
  const sign = v < 0 ? "−" : "", size = Math.abs(v);
  if (!unit || unit === "%") return `${sign}${size >= 1e5 || (size && size < 1e-3) ? power(size) : general(size, 4)}${unit ? " %" : ""}`;
  const common = largest ? prefixOf(largest, unit) : [1, ""], [factor, prefix] = !size || (largest && size >= 1e-4 * common[0] && size < 1e4 * common[0]) ? common : prefixOf(size, unit), step = largest && factor === common[0] ? 10 ** (Math.floor(Math.log10(largest / factor)) - 4) : 0, shown = step && size < 1e3 * step * factor ? step * Math.round(size / factor / step) : size / factor;
  return `${shown ? sign : ""}${shown >= 1e4 || (shown && shown < 1e-4) ? power(shown) : general(shown, 4)} ${prefix}${unit}`;
}
const power = (x) => local(x.toExponential(2)).replace(/e\+?(-?)(\d+)/, (_, s, n) => ` × 10${s ? "⁻" : ""}${[...n].map((c) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]).join("")}`);

const AMOUNT = /\d[\d.]*(?:e[-+]?\d+)?(?: (?:%|[GMkmµnp]?(?:Pa|J|N|m)\b))?/g;
/** What Python has told in English, in the reader's language where it has these words: numbers fill the gaps of a sentence. */
export function recounted(t, told) {
  const said = (text) => { const gaps = []; return t(`told_${text.replace(/\b1 (generation|agent)\b/g, "1 $1s").replace(AMOUNT, (number) => `{${gaps.push(local(number)) - 1}}`)}`, { ...gaps, otherwise: text.replace(AMOUNT, local) }); };
  return told.split(/(; |, without limit: | along )/).map(said).join("");
}

/** The certificate in words: in English those of kaju.stability. */
export function verdictOf(certificate, rule, t) {
  const { generations: n, name: m, tried, stable } = certificate;
  const percent = general(100 * (certificate.upper - 1), 3), growing = n * Math.log(certificate.upper) > Math.log(1e12);
  if (n !== null && !tried) return n === 0 ? t("nothing") : (n === 1 ? t("ends1") : t("ends", { n })) + (growing ? t("growing", { p: percent }) : "");
  const a = !rule.accumulate ? t(certificate.undiminished ? "never" : "mayNever", { m })
    : certificate.upper === 1 ? t("stay") : certificate.lower <= 1 ? t("mayGrow", { m, p: percent }) : t("grow", { p: general(100 * (certificate.lower - 1), 3) });
  if (tried) return t("rests", { n, a });
  if (stable === null) return t("unlessEnded", { a });
  if (!rule.accumulate) return t("lower1", { a });
  const remedies = [["forwardBelow", certificate.forward], ["frictionBelow", certificate.friction]]
    .filter(([, limit]) => limit > 0).map(([word, limit]) => t(word, { x: general(limit, 4) }));
  return t("lower", { a, r: remedies.length ? remedies.join(t("or")) : t("allShares") });
}
