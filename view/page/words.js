// Every word a reader sees; a language is one more entry. {n} is filled in.

export const LANGUAGES = { en: "English", de: "Deutsch", ja: "日本語" };

const WORDS = {
  en: {
    play: "Play", pause: "Pause", back: "One generation back", step: "One generation on", first: "To the start",
    last: "To the end", speed: "Speed", perSecond: "{n} / s", timeline: "Generation", stage: "Stage", stageOf: "Stage {n} of {m}",
    generation: "Generation {g} of {n}", running: "Generation {g} of {n} …", language: "Language", theme: "Light or dark",
    runnable: "runs in this page", recorded: "a recorded run", live: "live from Python", gone: "Python is no longer there.", changed: "changed in this page",
    tabs: "Panels", rule: "Rule", look: "Look", draw: "Draw", about: "About", agent: "Agent", charts: "Charts", save: "Save", tries: "Try",
    colour: "Colours show", taken: "load taken so far", now: "load taken now", spawn: "generation of waking", kept: "load kept",
    stress: "pressure", move: "displacement", size: "size of the agent", deformed: "Deformed shape", magnified: "magnified {n} times", magnify: "Magnification",
    arrows: "Loads on their way", path: "Load path", beside: "Elastic answer beside it", error: "Difference between the two",
    cut: "Cut plane", cutAt: "Cut at", none: "none", only: "Only agents that are awake", turn: "Drag to turn the body.",
    alpha1: "α₁ kept", alpha2: "α₂ passed ahead", alpha3: "α₃ to each side", beta: "β free widening", nu: "ν Poisson's ratio", modulus: "E stiffness",
    gamma: "γ threshold", accumulate: "Add up loads that meet", sense: "Tell pushes from pulls", load: "Load", loadFactor: "Load ×", material: "Material",
    inspect: "Look and drag loads", pen: "Mouse", penMaterial: "Draw {name}", air: "Draw air", rigid: "Draw rigid", hold: "Held sides",
    left: "left", right: "right", bottom: "bottom", top: "top", front: "front", backSide: "back",
    free: "free", rigidSide: "rigid", roller: "roller", reset: "As it was", resetHint: "Everything as it was at first",
    agents: "agents awake", onTheWay: "load on its way", largest: "largest load", residual: "left unbalanced", ledger: "taken / ended in all",
    asItWas: "As it was", tryAdd: "Add up what meets", tryWalk: "No sideways push (β = 1)", tryFine: "A finer threshold (γ / 10)", tryBlow: "Make it blow up",
    pick: "Click a cell to read its story. Drag an orange arrow to move a load.", asleep: "No agent here: no load above γ has arrived.",
    isAir: "Air: a free boundary.", isRigid: "Rigid: gives loads back, reversed.", isRoller: "A roller.", cellOf: "Cell {c}", woken: "Woken", byWhom: "in generation {g} by {w}",
    outside: "the applied load", itself: "what came back", took: "Took", keptIt: "Kept", passedOn: "Passed on", ended: "Let end", gotBack: "Got back", unknown: "not known",
    atEnd: "known at the end of the run", thisGeneration: "now", pushes: "push", pulls: "pull",
    saveScene: "Scene (TOML)", savePng: "Picture (PNG)", saveSvg: "Picture (SVG)", saveFilm: "Film (WebM)", saveCsv: "Agents (CSV)", filming: "Filming …", saved: "Saved {name}.",
    keys: "Space: play or pause · ← →: one generation · Home, End: start, end · Tab to the picture, then arrows: walk from cell to cell, Enter: draw",
    bodyWord: "The body: {c}, {n} cells of material", noAnswer: "No elastic answer: {why}", solving: "Solving …", elastic: "elasticity", solvedIn: "solved in {n} s",
    misfit: "The rule's largest displacement is {a}, elasticity's {b}; on average they differ by {n} % of it.",
    ends: "every load ends within {n} generations", ends1: "every load ends within 1 generation", nothing: "no load exceeds the threshold: nothing happens",
    never: "a load that an agent of '{m}' passes on in one piece is not smaller than the load it took, so it never ends: lower forward (α₂), friction (α₃) and α₁ below 1",
    grow: "loads grow by {p} % a generation", mayGrow: "loads may grow by up to {p} % a generation in '{m}'",
    lower: "{a}: lower {r}, or judge each load by itself (accumulate = false)", or: " or ", forwardBelow: "forward (α₂) below {x}", frictionBelow: "friction (α₃) below {x}", allShares: "all shares of it",
    grown: "The loads have grown beyond all bounds; the run was stopped.", network: "network", points: "points", picture: "Picture of the body. {g}. {a} agents awake.",
    failed: "This page could not be drawn: {why}", lost: "Python does not answer any more.", time: "Time", moment: "{g} of {n}", 
    pictures: "a recorded run", pickPart: "Click a part to read its numbers.", part: "Part {n}", parents: "Parents of {n} cells act", along_step: "Step", along_generation: "Generation",
    along_stage: "Stage of loading", along_share: "Share of the load", value_tension: "pull (+) or push (−)", value_von_mises: "equivalent stress",
    value_load_taken: "load taken", value_load_left: "load left unbalanced", value_level: "level: how often halved", value_unbalanced_load: "load left unbalanced", value_spawn_step: "generation of spawning",
  },
  de: {
    play: "Abspielen", pause: "Pause", back: "Eine Generation zurück", step: "Eine Generation weiter", first: "Zum Anfang",
    last: "Zum Ende", speed: "Tempo", perSecond: "{n} / s", timeline: "Generation", stage: "Stufe", stageOf: "Stufe {n} von {m}",
    generation: "Generation {g} von {n}", running: "Generation {g} von {n} …", language: "Sprache", theme: "Hell oder dunkel",
    runnable: "rechnet in dieser Seite", recorded: "ein aufgezeichneter Lauf", live: "live aus Python", gone: "Python ist nicht mehr da.", changed: "in dieser Seite geändert",
    tabs: "Tafeln", rule: "Regel", look: "Ansicht", draw: "Malen", about: "Worum es geht", agent: "Agent", charts: "Kurven", save: "Sichern", tries: "Versuche",
    colour: "Farben zeigen", taken: "bisher aufgenommene Last", now: "jetzt aufgenommene Last", spawn: "Generation des Erwachens", kept: "behaltene Last",
    stress: "Druck", move: "Verschiebung", size: "Größe des Agenten", deformed: "Verformte Gestalt", magnified: "{n}-fach vergrößert", magnify: "Vergrößerung",
    arrows: "Lasten unterwegs", path: "Lastpfad", beside: "Elastische Lösung daneben", error: "Unterschied der beiden",
    cut: "Schnittebene", cutAt: "Schnitt bei", none: "keine", only: "Nur wache Agenten", turn: "Ziehen dreht den Körper.",
    alpha1: "α₁ behalten", alpha2: "α₂ nach vorn", alpha3: "α₃ je Seite", beta: "β freie Dehnung", nu: "ν Querdehnzahl", modulus: "E Steifigkeit",
    gamma: "γ Schwelle", accumulate: "Zusammentreffende Lasten addieren", sense: "Druck und Zug unterscheiden", load: "Last", loadFactor: "Last ×", material: "Material",
    inspect: "Ansehen und Lasten ziehen", pen: "Maus", penMaterial: "{name} malen", air: "Luft malen", rigid: "Starres malen", hold: "Gehaltene Seiten",
    left: "links", right: "rechts", bottom: "unten", top: "oben", front: "vorn", backSide: "hinten",
    free: "frei", rigidSide: "starr", roller: "Rollen", reset: "Wie zuvor", resetHint: "Alles wie am Anfang",
    agents: "wache Agenten", onTheWay: "Last unterwegs", largest: "größte Last", residual: "nicht ausgeglichen", ledger: "aufgenommen / geendet",
    asItWas: "Wie zuvor", tryAdd: "Treffende Lasten addieren", tryWalk: "Kein Querdruck (β = 1)", tryFine: "Feinere Schwelle (γ / 10)", tryBlow: "Aufschaukeln",
    pick: "Eine Zelle anklicken, um ihre Geschichte zu lesen. Einen orangen Pfeil ziehen, um eine Last zu verschieben.", asleep: "Kein Agent: Es kam keine Last über γ an.",
    isAir: "Luft: ein freier Rand.", isRigid: "Starr: gibt Lasten umgekehrt zurück.", isRoller: "Eine Rolle.", cellOf: "Zelle {c}", woken: "Geweckt", byWhom: "in Generation {g} von {w}",
    outside: "der angelegten Last", itself: "Zurückgekommenem", took: "Nahm auf", keptIt: "Behielt", passedOn: "Gab weiter", ended: "Ließ enden", gotBack: "Bekam zurück", unknown: "nicht bekannt",
    atEnd: "am Ende des Laufs bekannt", thisGeneration: "jetzt", pushes: "Druck", pulls: "Zug",
    saveScene: "Szene (TOML)", savePng: "Bild (PNG)", saveSvg: "Bild (SVG)", saveFilm: "Film (WebM)", saveCsv: "Agenten (CSV)", filming: "Wird gefilmt …", saved: "{name} gesichert.",
    keys: "Leertaste: abspielen oder anhalten · ← →: eine Generation · Pos1, Ende: Anfang, Ende · Tabulator zum Bild, dann Pfeile: von Zelle zu Zelle, Eingabe: malen",
    bodyWord: "Der Körper: {c}, {n} Zellen Material", noAnswer: "Keine elastische Lösung: {why}", solving: "Wird gelöst …", elastic: "Elastizität", solvedIn: "gelöst in {n} s",
    misfit: "Größte Verschiebung: Regel {a}, Elastizität {b}; im Mittel weichen sie um {n} % davon ab.",
    ends: "jede Last endet in höchstens {n} Generationen", ends1: "jede Last endet in höchstens einer Generation", nothing: "keine Last überschreitet die Schwelle: es geschieht nichts",
    never: "eine Last, die ein Agent aus '{m}' in einem Stück weitergibt, ist nicht kleiner als die aufgenommene und endet daher nie: α₂, α₃ und α₁ unter 1 senken",
    grow: "Lasten wachsen um {p} % je Generation", mayGrow: "Lasten wachsen in '{m}' um bis zu {p} % je Generation",
    lower: "{a}: {r} senken oder jede Last einzeln beurteilen", or: " oder ", forwardBelow: "α₂ (nach vorn) unter {x}", frictionBelow: "α₃ (je Seite) unter {x}", allShares: "alle Anteile",
    grown: "Die Lasten sind über alle Grenzen gewachsen; der Lauf wurde angehalten.", network: "Netzwerk", points: "Punkte", picture: "Bild des Körpers. {g}. {a} wache Agenten.",
    failed: "Diese Seite konnte nicht gezeichnet werden: {why}", lost: "Python antwortet nicht mehr.", time: "Zeit", moment: "{g} von {n}", 
    pictures: "ein aufgezeichneter Lauf", pickPart: "Ein Teil anklicken, um seine Zahlen zu lesen.", part: "Teil {n}", parents: "Eltern von {n} Zellen handeln", along_step: "Schritt", along_generation: "Generation",
    along_stage: "Laststufe", along_share: "Anteil der Last", value_tension: "Zug (+) oder Druck (−)", value_von_mises: "Vergleichsspannung",
    value_load_taken: "aufgenommene Last", value_load_left: "nicht ausgeglichene Last", value_level: "Stufe: wie oft halbiert", value_unbalanced_load: "nicht ausgeglichene Last", value_spawn_step: "Generation der Entstehung",
  },
  ja: {
    play: "再生", pause: "一時停止", back: "一世代もどる", step: "一世代すすむ", first: "はじめへ",
    last: "おわりへ", speed: "速さ", perSecond: "{n} / s", timeline: "世代", stage: "段階", stageOf: "段階 {n} / {m}",
    generation: "世代 {g} / {n}", running: "世代 {g} / {n} …", language: "言語", theme: "明るい / 暗い",
    runnable: "このページで計算", recorded: "記録された計算", live: "Python から実況", gone: "Python との接続が切れました。", changed: "このページで変更",
    tabs: "パネル", rule: "規則", look: "表示", draw: "描く", about: "説明", agent: "エージェント", charts: "グラフ", save: "保存", tries: "試す",
    colour: "色が示すもの", taken: "これまでに受けた荷重", now: "いま受けた荷重", spawn: "目覚めた世代", kept: "保持した荷重",
    stress: "圧力", move: "変位", size: "エージェントの大きさ", deformed: "変形した形", magnified: "{n} 倍に拡大", magnify: "拡大率",
    arrows: "移動中の荷重", path: "荷重の経路", beside: "弾性解を並べる", error: "両者の差",
    cut: "断面", cutAt: "断面の位置", none: "なし", only: "目覚めたエージェントのみ", turn: "ドラッグで物体を回します。",
    alpha1: "α₁ 保持", alpha2: "α₂ 前へ", alpha3: "α₃ 両横へ", beta: "β 自由な膨張", nu: "ν ポアソン比", modulus: "E 剛性",
    gamma: "γ しきい値", accumulate: "出会った荷重を足す", sense: "押しと引きを区別", load: "荷重", loadFactor: "荷重 ×", material: "材料",
    inspect: "見る・荷重を動かす", pen: "マウス", penMaterial: "{name} を描く", air: "空気を描く", rigid: "剛体を描く", hold: "辺の支え",
    left: "左", right: "右", bottom: "下", top: "上", front: "手前", backSide: "奥",
    free: "自由", rigidSide: "固定", roller: "ローラー", reset: "もとに戻す", resetHint: "すべてはじめの状態に戻す",
    agents: "目覚めた数", onTheWay: "移動中の荷重", largest: "最大の荷重", residual: "残りの不釣合い", ledger: "受けた / 消えた合計",
    asItWas: "もとのまま", tryAdd: "出会う荷重を足す", tryWalk: "横押しなし (β = 1)", tryFine: "細かいしきい値 (γ / 10)", tryBlow: "発散させる",
    pick: "セルをクリックすると経緯が読めます。オレンジの矢印をドラッグすると荷重が動きます。", asleep: "エージェントなし：γ を超える荷重は届いていません。",
    isAir: "空気：自由な境界。", isRigid: "剛体：荷重を逆向きに返します。", isRoller: "ローラー。", cellOf: "セル {c}", woken: "目覚め", byWhom: "世代 {g}、{w} による",
    outside: "加えた荷重", itself: "戻ってきた荷重", took: "受けた", keptIt: "保持", passedOn: "渡した", ended: "消えた", gotBack: "戻された", unknown: "不明",
    atEnd: "計算の終わりに分かります", thisGeneration: "いま", pushes: "押し", pulls: "引き",
    saveScene: "シーン (TOML)", savePng: "画像 (PNG)", saveSvg: "画像 (SVG)", saveFilm: "動画 (WebM)", saveCsv: "エージェント (CSV)", filming: "録画中 …", saved: "{name} を保存しました。",
    keys: "スペース：再生・停止 · ← →：一世代 · Home, End：はじめ・おわり · Tab で画像へ、矢印でセルを移動、Enter で描く",
    bodyWord: "物体：{c}、材料のセル {n} 個", noAnswer: "弾性解はありません：{why}", solving: "計算中 …", elastic: "弾性", solvedIn: "{n} 秒で計算",
    misfit: "最大変位：規則 {a}、弾性 {b}。平均の差はその {n} %。",
    ends: "すべての荷重は {n} 世代以内に消えます", ends1: "すべての荷重は 1 世代以内に消えます", nothing: "しきい値を超える荷重がなく、何も起こりません",
    never: "「{m}」のエージェントが一つのまま渡す荷重は受けた荷重より小さくならず、消えません：α₂・α₃・α₁ を 1 より小さくしてください",
    grow: "荷重は一世代ごとに {p} % 増えます", mayGrow: "「{m}」で荷重は一世代ごとに最大 {p} % 増えます",
    lower: "{a}：{r}にするか、荷重を一つずつ判定してください", or: "、または ", forwardBelow: "前へ (α₂) を {x} 未満", frictionBelow: "横へ (α₃) を {x} 未満", allShares: "すべての割合を小さく",
    grown: "荷重が際限なく増えたため、計算を止めました。", network: "ネットワーク", points: "点", picture: "物体の図。{g}。目覚めたエージェント {a}。",
    failed: "このページを描けませんでした：{why}", lost: "Python からの応答がありません。", time: "時間", moment: "{g} / {n}", 
    pictures: "記録された計算", pickPart: "部分をクリックすると数値が読めます。", part: "部分 {n}", parents: "{n} セルの親が働く", along_step: "ステップ", along_generation: "世代",
    along_stage: "載荷段階", along_share: "荷重の割合", value_tension: "引き (+)・押し (−)", value_von_mises: "相当応力",
    value_load_taken: "受けた荷重", value_load_left: "残りの不釣合い荷重", value_level: "階層：半分にした回数", value_unbalanced_load: "残りの不釣合い荷重", value_spawn_step: "生まれた世代",
  },
};

export const say = (language) => (key, values = {}) => {
  const text = WORDS[language]?.[key] ?? WORDS.en[key];
  if (text === undefined) throw new Error(`no word for ${key}`);
  return text.replace(/\{(\w+)\}/g, (_, name) => values[name]);
};
export const catalogue = () => WORDS;

// ------------------------------------------------------------------------------------ numbers

/** A number with so many significant digits, as Python's format code "g" writes it. */
export function general(x, digits) {
  if (x === 0) return "0";
  const [mantissa, exponent] = x.toExponential(digits - 1).split("e"), e = Number(exponent);
  const plain = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);
  if (e < -4 || e >= digits) return `${plain(mantissa)}e${e < 0 ? "-" : "+"}${String(Math.abs(e)).padStart(2, "0")}`;
  return plain(x.toFixed(Math.max(0, digits - 1 - e)));
}

const PREFIXES = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"], [1e-12, "p"]];

/** Four digits and a unit that fits: 12.88 N, 3.2 nm, 206 GPa. */
export function quantity(v, unit) {
  if (!Number.isFinite(v)) return "–";
  const sign = v < 0 ? "−" : "", size = Math.abs(v);
  if (!unit) return sign + (size >= 1e5 || (size && size < 1e-3) ? power(size) : general(size, 4));
  if (size === 0) return `0 ${unit}`;
  const [factor, prefix] = PREFIXES.find(([f]) => size >= 0.99995 * f) ?? PREFIXES.at(-1);
  const shown = size / factor;
  return `${sign}${shown >= 1e4 || shown < 1e-2 ? power(shown) : general(shown, 4)} ${prefix}${unit}`;
}
const power = (x) => x.toExponential(2).replace(/e\+?(-?)(\d+)/, (_, s, n) => ` × 10${s ? "⁻" : ""}${[...n].map((c) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]).join("")}`);

/** The certificate in words: in English those of kaju.stability. */
export function verdictOf(certificate, rule, t) {
  const { generations: n, name: m } = certificate;
  if (n !== null) return n === 0 ? t("nothing") : n === 1 ? t("ends1") : t("ends", { n });
  if (!rule.accumulate) return t("never", { m });
  const a = certificate.lower < 1 ? t("mayGrow", { m, p: general(100 * (certificate.upper - 1), 3) })
    : t("grow", { p: general(100 * (certificate.lower - 1), 3) });
  const remedies = [["forwardBelow", certificate.forward], ["frictionBelow", certificate.friction]]
    .filter(([, limit]) => limit > 0).map(([word, limit]) => t(word, { x: general(limit, 4) }));
  return t("lower", { a, r: remedies.length ? remedies.join(t("or")) : t("allShares") });
}
