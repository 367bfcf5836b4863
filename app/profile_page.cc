// The page of `profile --html`: tables, and a timeline on a canvas, drawn by its own script; nothing is loaded.
#include "app/profile_views.h"

namespace rilievo::app {

const char* const kProfilePage = R"page(<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>@TITLE@: where the time went</title>
<style>
:root{--ink:#222;--soft:#666;--line:#d8d8d8;--paper:#fff;--band:#f4f4f2}
@media(prefers-color-scheme:dark){:root{--ink:#e6e6e6;--soft:#a0a0a0;--line:#444;--paper:#1b1b1b;--band:#262626}}
body{font:14px/1.45 system-ui,sans-serif;color:var(--ink);background:var(--paper);margin:1.2em 1.6em}
h1{font-size:1.3em;margin:0 0 .2em}h2{font-size:1.05em;margin:1.4em 0 .4em}p{margin:.2em 0;color:var(--soft)}
table{border-collapse:collapse;font-variant-numeric:tabular-nums}
th,td{padding:.15em .7em;text-align:right;border-bottom:1px solid var(--line);white-space:nowrap}
th{font-weight:600;border-bottom-width:2px}th:first-child,td:first-child{text-align:left}
tr.stage{cursor:pointer}tr.off{opacity:.35}
.key{display:inline-block;width:.8em;height:.8em;border-radius:2px;margin-right:.5em}
#box{position:relative;border:1px solid var(--line);border-radius:4px;overflow:hidden}
canvas{display:block;width:100%;cursor:grab;touch-action:none}canvas:focus{outline:2px solid #0072b2}
#tip{position:absolute;display:none;pointer-events:none;background:var(--paper);color:var(--ink);
border:1px solid var(--soft);border-radius:4px;padding:.4em .7em;font-size:13px;white-space:pre;box-shadow:0 2px 8px #0004;z-index:2}
.scroll{overflow-x:auto}button{font:inherit;padding:0 .6em}
</style></head><body>
<h1>@TITLE@</h1><p id="summary"></p>
<h2>Stages</h2><div class="scroll"><table id="stages"></table></div>
<p>Wall: while a task of the stage ran. Cores: CPU / wall. Machine: CPU of all that the threads had. Click a row to hide or show it below.</p>
<h2>Timeline</h2>
<p>A row a worker, a colour a stage; pale: helping in a loop of another worker's task; outlined: on the critical path. Wheel or +/&minus;: zoom;
drag or arrows: move; double click or 0: all. <button id="all">all</button></p>
<div id="box"><canvas id="view" tabindex="0"></canvas><div id="tip"></div></div>
<h2>Kernels</h2><div class="scroll"><table id="kernels"></table></div>
<h2>Longest idle gaps</h2><div class="scroll"><table id="gaps"></table></div>
<script id="data" type="application/json">@DATA@</script>
<script>
"use strict";
const D=JSON.parse(document.getElementById("data").textContent),T=D.spans.tasks,H=D.spans.helpers;
const COLOURS=["#0072b2","#e69f00","#009e73","#cc79a7","#d55e00","#56b4e9","#b8a800","#7a5195","#8c564b","#7f7f7f"];
const colour=s=>COLOURS[s%COLOURS.length],hidden=new Set();
const bytes=b=>{if(b==null)return"not recorded";const u=["B","KiB","MiB","GiB","TiB"];let i=0;while(b>=1024&&i<4){b/=1024;i++}return(i&&b<100?b.toFixed(1):Math.round(b))+" "+u[i]};
const time=s=>s>=3600?Math.floor(s/3600)+" h "+String(Math.round(s%3600/60)).padStart(2,"0")+" min":s>=60?Math.floor(s/60)+" min "+String(Math.round(s%60)).padStart(2,"0")+" s":s>=1?s.toFixed(2)+" s":(1e3*s).toFixed(s>=.01?0:2)+" ms";
const percent=x=>(100*x).toFixed(0)+" %";
function table(id,head,rows){const t=document.getElementById(id);if(!rows.length){t.replaceWith(Object.assign(document.createElement("p"),{textContent:"none"}));return[]}
const row=(cells,kind)=>{const r=t.insertRow();for(const c of cells){const e=document.createElement(kind);e.textContent=c;r.appendChild(e)}return r};
row(head,"th");return rows.map(r=>row(r,"td"))}
document.getElementById("summary").textContent=time(D.wall_s)+" on "+D.threads+" threads, workers "+percent(D.busy_share)+" busy, processor time "+time(D.cpu_s)+" ("+percent(D.cpu_share)+" of the cores), critical path "+time(D.critical_path.length_s)+", "+bytes(D.memory.planned_peak_bytes)+" planned at most. "+(D.processor||"");
table("stages",["stage","tasks","reused","wall","rate","CPU","cores","machine","critical","read","written","planned peak","process peak"],
D.stages.map(s=>[s.name,s.tasks,s.reused,time(s.wall_s),s.units>0?s.units_per_s.toPrecision(3)+" "+s.unit+"/s":"-",time(s.cpu_s),s.cores.toFixed(2),percent(s.share_of_machine),time(s.critical_s),bytes(s.read_bytes),bytes(s.written_bytes),bytes(s.planned_peak_bytes),bytes(s.resident_peak_bytes)]))
.forEach((r,i)=>{const k=document.createElement("span");k.className="key";k.style.background=colour(i);r.cells[0].prepend(k);r.className="stage";
r.onclick=()=>{hidden.has(i)?hidden.delete(i):hidden.add(i);r.classList.toggle("off");draw()}});
table("kernels",["kernel","stage","CPU","rate of a core","machine's peak","share"],D.kernels.map(k=>[k.name,k.stage,time(k.cpu_s),(1e-9*k.rate_per_s).toFixed(1)+" GMAC/s",k.peak_per_s?(1e-9*k.peak_per_s).toFixed(1)+" GMAC/s":"not known",k.share_of_peak?percent(k.share_of_peak):"-"]));
table("gaps",["worker","from","to","length","beside"],D.gaps.map(g=>[g.worker,time(g.start_s),time(g.end_s),time(g.end_s-g.start_s),g.beside||"nothing"]));

const canvas=document.getElementById("view"),tip=document.getElementById("tip"),g=canvas.getContext("2d");
const LEFT=74,TOP=24,ROW=30,MEMORY=120,GAP=26;
let workers=D.threads;for(const t of T)workers=Math.max(workers,t[2]+1);
const FULL=Math.max(D.wall_s,1e-6),HEIGHT=TOP+workers*ROW+GAP+MEMORY+24;
let from=0,to=FULL,width=800;
const x=t=>LEFT+(t-from)/(to-from)*(width-LEFT-8),at=px=>from+(px-LEFT)/(width-LEFT-8)*(to-from);
const byRow=Array.from({length:workers},()=>[]);
T.forEach((t,i)=>byRow[t[2]].push([t[3],t[4],i,false]));H.forEach(h=>{if(byRow[h[1]])byRow[h[1]].push([h[2],h[3],h[0],true])});
byRow.forEach(r=>r.sort((a,b)=>a[0]-b[0]));
const MOST=Math.max(1,D.memory.allowed_bytes?D.memory.allowed_bytes+D.memory.overhead_bytes:0,D.memory.planned_peak_bytes,D.memory.process_peak_bytes);
let SCALE=Math.max(1,D.memory.planned_peak_bytes,D.memory.process_peak_bytes);if(MOST<2*SCALE)SCALE=MOST;
function step(span,count){const raw=span/count,p=Math.pow(10,Math.floor(Math.log10(raw)));for(const m of[1,2,5,10])if(m*p>=raw)return m*p}
function curve(points,y,steps){g.beginPath();let last=null,px=-1,top=0;
for(const[t,b]of points){const X=x(t);if(last!==null&&steps)g.lineTo(X,y(last));last===null?g.moveTo(X,y(b)):g.lineTo(X,y(b));last=b}
g.stroke()}
function draw(){const css=getComputedStyle(document.documentElement),ink=css.getPropertyValue("--ink"),soft=css.getPropertyValue("--soft"),line=css.getPropertyValue("--line"),band=css.getPropertyValue("--band");
const dpr=window.devicePixelRatio||1;width=canvas.parentElement.clientWidth||800;canvas.style.height=HEIGHT+"px";canvas.width=width*dpr;canvas.height=HEIGHT*dpr;
g.setTransform(dpr,0,0,dpr,0,0);g.clearRect(0,0,width,HEIGHT);g.font="12px system-ui,sans-serif";g.textBaseline="middle";
const base=TOP+workers*ROW+GAP,foot=base+MEMORY;
for(let w=0;w<workers;w++){if(w%2==0){g.fillStyle=band;g.fillRect(LEFT,TOP+w*ROW,width-LEFT,ROW)}g.fillStyle=ink;g.textAlign="left";g.fillText("worker "+w,8,TOP+w*ROW+ROW/2)}
const s=step(to-from,Math.max(2,(width-LEFT)/110));g.textAlign="center";
for(let t=Math.ceil(from/s)*s;t<=to;t+=s){g.strokeStyle=line;g.beginPath();g.moveTo(x(t),TOP);g.lineTo(x(t),foot);g.stroke();g.fillStyle=soft;g.fillText(s<.01?(1e3*t).toFixed(2)+" ms":s<1?(1e3*t).toFixed(0)+" ms":t.toFixed(s<10?1:0)+" s",x(t),TOP/2)}
g.save();g.beginPath();g.rect(LEFT,0,width-LEFT,HEIGHT);g.clip();
for(let w=0;w<workers;w++){let drawn=-1,stage=-1;for(const[a,b,i,helps]of byRow[w]){const t=T[i];if(b<from||a>to||hidden.has(t[1]))continue;
const xa=x(a),xb=Math.max(x(b),xa+.7);if(xb-xa<1&&Math.floor(xa)===drawn&&stage===t[1])continue;drawn=Math.floor(xa);stage=t[1];
g.globalAlpha=helps?.4:t[9]==="reused"?.65:1;g.fillStyle=t[9]==="failed"?"#c00000":colour(t[1]);g.fillRect(xa,TOP+w*ROW+3,Math.max(.7,xb-xa-(xb-xa>3?1:0)),ROW-6);g.globalAlpha=1;
if(t[12]&&!helps&&xb-xa>2){g.strokeStyle=ink;g.lineWidth=2;g.strokeRect(xa+1,TOP+w*ROW+4,xb-xa-3,ROW-8);g.lineWidth=1}
if(xb-xa>60){g.save();g.beginPath();g.rect(xa,TOP+w*ROW,xb-xa-4,ROW);g.clip();g.fillStyle="#fff";g.textAlign="left";g.fillText((helps?"loop of ":"")+t[0],Math.max(xa,LEFT)+6,TOP+w*ROW+ROW/2);g.restore()}}}
const y=b=>foot-b/SCALE*MEMORY;
if(D.memory.allowed_bytes&&MOST<=SCALE){g.setLineDash([5,4]);g.strokeStyle="#d55e00";g.beginPath();g.moveTo(LEFT,y(MOST));g.lineTo(width,y(MOST));g.stroke();g.setLineDash([])}
g.strokeStyle="#0072b2";g.lineWidth=1.5;curve(D.curves.planned,y,true);g.strokeStyle="#009e73";curve(D.curves.resident,y,false);g.lineWidth=1;g.restore();
g.strokeStyle=line;g.strokeRect(LEFT+.5,base+.5,width-LEFT-1,MOST?MEMORY:0);
g.textAlign="left";g.fillStyle=soft;g.fillText("memory",8,base+8);g.fillText(bytes(SCALE),8,base+24);
g.fillStyle="#0072b2";g.fillText("\u2014 planned (tasks)",LEFT+8,foot+12);g.fillStyle="#009e73";g.fillText("\u2014 resident (process)",LEFT+130,foot+12);
if(D.memory.allowed_bytes){g.fillStyle="#d55e00";g.fillText("-- allowed "+bytes(D.memory.allowed_bytes+D.memory.overhead_bytes),LEFT+270,foot+12)}}
function move(a,b){const span=Math.min(FULL,Math.max(1e-5,b-a));from=Math.min(Math.max(0,a),FULL-span);to=from+span;draw()}
function zoom(f,c){c=c??(from+to)/2;move(c-(c-from)*f,c+(to-c)*f)}
canvas.addEventListener("wheel",e=>{e.preventDefault();if(Math.abs(e.deltaX)>Math.abs(e.deltaY)){const d=e.deltaX/(width-LEFT)*(to-from);move(from+d,to+d)}else zoom(Math.exp(e.deltaY*.0015),at(e.offsetX))},{passive:false});
let grip=null;canvas.addEventListener("pointerdown",e=>{grip=[e.clientX,from,to];canvas.setPointerCapture(e.pointerId);canvas.style.cursor="grabbing"});
canvas.addEventListener("pointerup",()=>{grip=null;canvas.style.cursor="grab"});
canvas.addEventListener("dblclick",()=>move(0,FULL));document.getElementById("all").onclick=()=>move(0,FULL);
canvas.addEventListener("keydown",e=>{const d=(to-from)/5;if(e.key==="+"||e.key==="=")zoom(.7);else if(e.key==="-")zoom(1/.7);else if(e.key==="ArrowLeft")move(from-d,to-d);else if(e.key==="ArrowRight")move(from+d,to+d);else if(e.key==="0")move(0,FULL);else return;e.preventDefault()});
function find(px,py){const w=Math.floor((py-TOP)/ROW);if(w<0||w>=workers||px<LEFT)return null;const slack=2*(to-from)/width,t=at(px);let best=null;
for(const s of byRow[w])if(!hidden.has(T[s[2]][1])&&s[0]-slack<=t&&t<=s[1]+slack&&(!best||s[1]-s[0]<best[1]-best[0]||best[3]))best=s;return best}
function valueAt(points,t,after){let v=0;for(const[u,b]of points){if(u>t){if(after)v=b;break}v=b}return v}
canvas.addEventListener("pointermove",e=>{if(grip){const d=(grip[0]-e.clientX)/(width-LEFT)*(grip[2]-grip[1]);move(grip[1]+d,grip[2]+d);return}
const s=find(e.offsetX,e.offsetY);let text="";if(s){const t=T[s[2]];text=(s[3]?"loop of ":"")+t[0]+"\n"+D.stages[t[1]].name+", "+t[9]+(t[12]?", on the critical path":"")+"\nfrom "+time(s[0])+" for "+time(s[1]-s[0])+"\nCPU "+time(t[5])+(t[10]?", "+t[10].toPrecision(3)+" "+t[11]:"")+"\nread "+bytes(t[6])+", written "+bytes(t[7])+"\nplanned peak "+bytes(t[8])}
else if(e.offsetY>TOP+workers*ROW&&e.offsetX>LEFT){const t=at(e.offsetX);text="at "+time(t)+"\nplanned "+bytes(valueAt(D.curves.planned,t,false))+"\nresident "+bytes(valueAt(D.curves.resident,t,true))}
tip.style.display=text?"block":"none";tip.textContent=text;const room=width-tip.offsetWidth-12;tip.style.left=Math.max(0,Math.min(e.offsetX+14,room))+"px";tip.style.top=Math.max(0,Math.min(e.offsetY+16,HEIGHT-tip.offsetHeight-4))+"px"});
canvas.addEventListener("pointerleave",()=>tip.style.display="none");window.addEventListener("resize",draw);draw();
</script></body></html>
)page";

}  // namespace rilievo::app
