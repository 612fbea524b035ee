// The page of the report: style, layout and a small canvas viewer of our own; no other file is loaded.
#include "tools/gap_report.h"

namespace teres::tools {

const char* const kGapReportPage = R"PAGE(<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Gap diagnosis: @TITLE@</title>
<style>
body{font:15px/1.5 system-ui,sans-serif;margin:0;color:#1d2733;background:#f4f6f8}
main{max-width:1180px;margin:0 auto;padding:20px}
h1{font-size:22px;margin:8px 0}h2{font-size:17px;margin:0 0 8px}
section{background:#fff;border:1px solid #d9dfe5;border-radius:6px;padding:16px;margin:14px 0}
.verdict{font-size:18px;border-left:6px solid #b4472e}
.verdict.none{border-left-color:#2c7a4b}.verdict.unknown{border-left-color:#b8860b}
table{border-collapse:collapse}td,th{padding:3px 10px;text-align:left;border-bottom:1px solid #e5e9ee;vertical-align:top}
.bar{background:#3d6f9e;height:12px;display:inline-block}
.row{display:flex;gap:20px;flex-wrap:wrap}.row>div{flex:1 1 420px}
canvas{background:#fbfcfd;border:1px solid #e0e5ea;max-width:100%;touch-action:none}
small,.note{color:#5c6b7a}.heat td{padding:2px 4px;font-size:11px;text-align:center;border:1px solid #fff}
.heat th{font-size:11px;padding:2px 4px;border:0;font-weight:normal}.heat th.v{writing-mode:vertical-rl;transform:rotate(180deg)}
</style></head><body><main>
<h1>Where simulation and recording part: @TITLE@</h1>
<section class="verdict" id="verdict">@VERDICT@</section>
<section><h2>What to do next</h2><div id="next"></div></section>
<section><h2>The body, coloured by the gap</h2>
<div class="row"><div><canvas id="body" width="620" height="470"></canvas>
<div><button id="play">play</button> <input type="range" id="time" min="0" value="0" style="width:420px"> <span id="now"></span></div>
<div><label><input type="radio" name="shape" value="before" checked> nominal</label>
<label><input type="radio" name="shape" value="after"> with the named effects</label>
<small>drag to turn, wheel to zoom</small></div>
<div><label>colour: <select id="colour"></select></label></div></div>
<div><canvas id="scale" width="260" height="44"></canvas>
<p class="note" id="legend"></p><h2>Markers: share of the gap</h2><canvas id="shares" width="420" height="170"></canvas></div></div></section>
<section><h2>Observed minus simulated over time</h2><canvas id="residuals" width="1100" height="260"></canvas>
<p class="note">rms over the seen markers; shaded: never fitted. Data: <a href="residuals.csv">residuals.csv</a></p></section>
<section><h2>Answers, most probable first</h2><table id="causes"></table>
<p class="note">Data: <a href="causes.csv">causes.csv</a>, <a href="parameters.csv">parameters.csv</a></p></section>
<section><h2>How far the gap closes on data never fitted</h2><table id="heldout"></table><div id="ladder"></div>
<p class="note">Data: <a href="ladder.csv">ladder.csv</a></p></section>
<section><h2>What this recording can tell apart</h2>
<p class="note">Row: an effect; column: what could stand in for it (share of its signature reproduced, 1 = inseparable). chi&sup2;: how visible
one prior standard deviation would be. Data: <a href="confusability.csv">confusability.csv</a></p><table id="overlap" class="heat"></table>
<div id="pairs"></div><p class="note" id="absent"></p></section>
</main><script id="data" type="application/json">@DATA@</script><script>
"use strict";
const D=JSON.parse(document.getElementById("data").textContent),$=id=>document.getElementById(id);
const num=(v,d=2)=>v===null||v===undefined?"-":(+v).toFixed(d);
const esc=s=>String(s).replace(/[&<>]/g,c=>({"&":"&amp;","<":"&lt;",">":"&gt;"}[c]));
// five-step colour scale, dark blue to red
const RAMP=[[44,62,110],[62,124,162],[150,190,150],[238,190,92],[186,52,40]];
function ramp(s){s=Math.max(0,Math.min(1,s))*(RAMP.length-1);const i=Math.min(RAMP.length-2,Math.floor(s)),w=s-i;
 return RAMP[i].map((c,k)=>c+(RAMP[i+1][k]-c)*w)}
const rgb=c=>`rgb(${c.map(Math.round).join()})`;

// verdict, next
if(!D.shrinkage.effects.length)$("verdict").classList.add(D.none_probability>=D.unknown_probability?"none":"unknown");
$("next").textContent=D.next_experiment;

// gap per surface node and frame [m]: between the two motions, or, if nothing is named, spread from the markers
const S=D.surface,T=D.time_s,N=S.node_id.length,F=S.before.length,M=D.markers.marker_id.length,U=S.unit_m;
const named=D.shrinkage.effects.length>0;
function markerGap(f,m,key){let s=0;for(let a=0;a<3;a++){const r=3*(f*M+m)+a,y=D.markers.observed_m[r];if(y===null)return null;s+=(y-D.markers[key][r])**2}return Math.sqrt(s)}
const sensor=D.where.kind==="sensor";
function nodeGap(f){const g=new Float32Array(N),B=S.before[f],A=S.after[f];
 if(named&&!sensor){for(let n=0;n<N;n++){let s=0;for(let a=0;a<3;a++)s+=(A[3*n+a]-B[3*n+a])**2;g[n]=U*Math.sqrt(s)}return g}
 const at=[];for(let m=0;m<M;m++){const v=markerGap(f,m,"before_m");if(v!==null)at.push([0,1,2].map(a=>D.markers.before_m[3*(f*M+m)+a]).concat(v))}
 for(let n=0;n<N;n++){let w=0,s=0;for(const p of at){const d=(U*B[3*n]-p[0])**2+(U*B[3*n+1]-p[1])**2+(U*B[3*n+2]-p[2])**2+1e-5;w+=1/d/d;s+=p[3]/d/d}g[n]=w?s/w:0}return g}
const gaps=[];let top_=0;for(let f=0;f<F;f++){gaps.push(nodeGap(f));for(const v of gaps[f])if(v>top_)top_=v}
const peak=top_||1e-9;

// maps of places: share of the gap that an effect there would explain by first order, spread over the surface
const MAPS=(D.maps||[]).map(m=>{const v=new Float32Array(N),X=S.before[0];
 for(let n=0;n<N;n++){let w=0,s=0;for(let k=0;k<m.explained.length;k++){let d=1e-6;for(let a=0;a<3;a++)d+=(U*X[3*n+a]-m.center_m[3*k+a])**2;w+=1/d/d;s+=m.explained[k]/d/d}v[n]=Math.max(0,s/w)}
 return{effect:m.effect,value:v,top:Math.max(1e-9,...m.explained)}});

// viewer: orthographic, painter's order
const view={yaw:.5,pitch:.3,zoom:1,frame:0,shape:"before",map:-1};
let lo=[1e9,1e9,1e9],hi=[-1e9,-1e9,-1e9];
if(F)for(let n=0;n<N;n++)for(let a=0;a<3;a++){const v=U*S.before[0][3*n+a];lo[a]=Math.min(lo[a],v);hi[a]=Math.max(hi[a],v)}
const mid=lo.map((v,a)=>(v+hi[a])/2),size=Math.hypot(...lo.map((v,a)=>hi[a]-v))||1;
function project(p){const cy=Math.cos(view.yaw),sy=Math.sin(view.yaw),cp=Math.cos(view.pitch),sp=Math.sin(view.pitch);
 const x=p[0]-mid[0],y=p[1]-mid[1],z=p[2]-mid[2],x1=cy*x+sy*z,z1=-sy*x+cy*z,y2=cp*y-sp*z1,z2=sp*y+cp*z1,k=view.zoom*480/size;
 return [310+k*x1,235-k*y2,z2]}
function draw(){const c=$("body").getContext("2d");c.clearRect(0,0,620,470);if(!F)return;
 const X=S[view.shape][view.frame],map=MAPS[view.map],g=map?map.value:gaps[view.frame],full=map?map.top:peak,P=[];
 for(let n=0;n<N;n++)P.push(project([U*X[3*n],U*X[3*n+1],U*X[3*n+2]]));
 const order=[];for(let t=0;t<S.triangle.length;t+=3){const a=P[S.triangle[t]],b=P[S.triangle[t+1]],d=P[S.triangle[t+2]];
  const nx=(b[1]-a[1])*(d[2]-a[2])-(b[2]-a[2])*(d[1]-a[1]),ny=(b[2]-a[2])*(d[0]-a[0])-(b[0]-a[0])*(d[2]-a[2]),nz=(b[0]-a[0])*(d[1]-a[1])-(b[1]-a[1])*(d[0]-a[0]);
  order.push([a[2]+b[2]+d[2],t,Math.abs(nz)/(Math.hypot(nx,ny,nz)||1)])}
 order.sort((p,q)=>p[0]-q[0]);
 for(const[,t,light]of order){const i=S.triangle[t],j=S.triangle[t+1],k=S.triangle[t+2],v=(g[i]+g[j]+g[k])/3/full,s=.55+.45*light;
  c.fillStyle=c.strokeStyle=rgb(ramp(v).map(q=>q*s));c.beginPath();c.moveTo(P[i][0],P[i][1]);c.lineTo(P[j][0],P[j][1]);c.lineTo(P[k][0],P[k][1]);c.closePath();c.fill();c.stroke()}
 const key=view.shape==="before"?"before_m":"after_m";
 for(let m=0;m<M;m++){const at=3*(view.frame*M+m),q=project([0,1,2].map(a=>D.markers[key][at+a])),y=D.markers.observed_m[at];
  if(y!==null){const o=project([0,1,2].map(a=>D.markers.observed_m[at+a]));c.strokeStyle="#111";c.lineWidth=1.5;c.beginPath();c.moveTo(q[0],q[1]);c.lineTo(o[0],o[1]);c.stroke();c.fillStyle="#fff";c.beginPath();c.arc(o[0],o[1],4,0,7);c.fill();c.stroke();c.lineWidth=1}}
 if(D.where.center_m){const q=project(D.where.center_m);c.strokeStyle="#d000c8";c.lineWidth=3;c.beginPath();c.arc(q[0],q[1],Math.max(9,(D.where.radius_m||0)*view.zoom*480/size),0,7);c.stroke();c.lineWidth=1;c.fillStyle="#d000c8";c.fillText("cause",q[0]+12,q[1]-10)
  for(const o of D.where.other_places||[]){const p=project(o.center_m);c.strokeStyle="#d000c8";c.setLineDash([4,4]);c.beginPath();c.arc(p[0],p[1],9,0,7);c.stroke();c.setLineDash([]);c.fillText("or here, odds "+num(o.odds,1),p[0]+12,p[1]-10)}}
 if(D.attachment){for(const p of D.attachment){const q=project(p);c.fillStyle="#00b050";c.fillRect(q[0]-1.5,q[1]-1.5,3,3)}}
 $("now").textContent=num(T[view.frame],2)+" s"}
const slider=$("time");slider.max=Math.max(0,F-1);slider.oninput=()=>{view.frame=+slider.value;draw()};
let timer=null;$("play").onclick=()=>{if(timer){clearInterval(timer);timer=null;$("play").textContent="play";return}
 $("play").textContent="stop";timer=setInterval(()=>{view.frame=(view.frame+1)%Math.max(1,F);slider.value=view.frame;draw()},80)};
for(const r of document.getElementsByName("shape"))r.onchange=()=>{view.shape=r.value;draw()};
const body=$("body");let last=null;
body.onpointerdown=e=>{last=[e.clientX,e.clientY];body.setPointerCapture(e.pointerId)};
body.onpointermove=e=>{if(!last)return;view.yaw+=(e.clientX-last[0])*.01;view.pitch+=(e.clientY-last[1])*.01;last=[e.clientX,e.clientY];draw()};
body.onpointerup=()=>{last=null};body.onwheel=e=>{e.preventDefault();view.zoom*=Math.exp(-e.deltaY*.001);draw()};
let worst=0,most=-1;for(let f=0;f<F;f++){let s=0;for(const v of gaps[f])s+=v*v;if(s>most){most=s;worst=f}}
view.frame=worst;slider.value=worst;
function legend(){const map=MAPS[view.map],c=$("scale").getContext("2d");c.clearRect(0,0,260,44);
 for(let x=0;x<240;x++){c.fillStyle=rgb(ramp(x/240));c.fillRect(10+x,4,1,14)}
 c.fillStyle="#1d2733";c.fillText("0",8,34);c.fillText(map?num(100*map.top,0)+" %":num(1e3*peak,1)+" mm",205,34);
 $("legend").textContent=(map?"Colour: share of the gap that "+map.effect+" at this place would explain, by first order. ":
  named&&!sensor?"Colour: how far the named effects move the body. ":"Colour: marker distances spread over the surface. ")+
 "White dots: observed markers, the line ends where the shown simulation has them."+(D.where.center_m?" Ring: place of the cause.":"")+(D.attachment?" Green: prior ligament region.":"")+" Data: surface_gap.csv, place_maps.csv, markers.csv."}
$("colour").innerHTML="<option value=-1>gap</option>"+MAPS.map((m,k)=>`<option value=${k}>${esc(m.effect)}: places that explain the gap</option>`).join("");
$("colour").onchange=e=>{view.map=+e.target.value;legend();draw()};
legend();

// charts
function axes(c,w,h,x0,x1,y1,xl,yl){c.strokeStyle="#8b98a5";c.fillStyle="#43505c";c.beginPath();c.moveTo(50,10);c.lineTo(50,h-30);c.lineTo(w-10,h-30);c.stroke();
 for(let k=0;k<=4;k++){const y=y1*k/4,py=h-30-(h-40)*k/4;c.fillText(num(y,1),18,py+4);c.strokeStyle="#eceff2";c.beginPath();c.moveTo(51,py);c.lineTo(w-10,py);c.stroke()}
 for(let k=0;k<=6;k++){const x=x0+(x1-x0)*k/6;c.textAlign=k<6?"center":"right";c.fillText(num(x,1),k<6?50+(w-60)*k/6:w-2,h-14)}c.textAlign="left";c.fillText(xl,w-70,h-2);c.fillText(yl,54,12)}
{const c=$("residuals").getContext("2d"),w=1100,h=260,line=[[],[]];
 for(let f=0;f<T.length;f++)["before_m","after_m"].forEach((key,k)=>{let s=0,n=0;for(let m=0;m<M;m++){const v=markerGap(f,m,key);if(v!==null){s+=v*v;n++}}line[k].push(n?1e3*Math.sqrt(s/n):null)});
 const y1=Math.max(...line.flat().filter(v=>v!==null),D.gap.noise_floor_mm)*1.05||1,x0=T[0],x1=T[T.length-1]||1,px=t=>50+(w-60)*(t-x0)/((x1-x0)||1),py=v=>h-30-(h-40)*v/y1;
 const held=D.markers.first_held_frame;if(held<T.length){c.fillStyle="#e9edf5";c.fillRect(px(T[held]),10,w-10-px(T[held]),h-40)}
 axes(c,w,h,x0,x1,y1,"time [s]","rms distance [mm]");
 c.setLineDash([5,4]);c.strokeStyle="#777";c.beginPath();c.moveTo(50,py(D.gap.noise_floor_mm));c.lineTo(w-10,py(D.gap.noise_floor_mm));c.stroke();c.setLineDash([]);
 ["#b4472e","#2c6fb0"].forEach((color,k)=>{c.strokeStyle=color;c.lineWidth=2;c.beginPath();let open=false;line[k].forEach((v,f)=>{if(v===null){open=false;return}open?c.lineTo(px(T[f]),py(v)):c.moveTo(px(T[f]),py(v));open=true});c.stroke();
  c.fillStyle=color;c.fillText(["nominal",D.ladder.some(l=>l.model_error)?"with named effects and model error":"with the named effects"][k],90+120*k,24)});c.lineWidth=1;c.fillStyle="#777";c.fillText("floor (dashed)",400,24)}
{const c=$("shares").getContext("2d"),list=D.where.markers,top=Math.max(...list.map(m=>m.share),.01);
 list.forEach((m,k)=>{const x=8+k*(404/list.length),b=Math.max(2,404/list.length-4),y=120*m.share/top;c.fillStyle="#3d6f9e";c.fillRect(x,140-y,b,y);c.fillStyle="#43505c";c.fillText(m.marker_id,x,154)});
 c.fillText("marker id; tallest "+num(100*top,0)+" %",8,168)}

// tables
const percent=v=>num(100*v,1)+" %";
let html="<tr><th>answer</th><th>probability</th><th></th><th>parameters</th><th>inseparable here</th></tr>";
const rowOf=(name,p,params,rivals)=>`<tr><td>${esc(name)}</td><td>${percent(p)}</td><td><span class="bar" style="width:${Math.round(160*p)}px"></span></td><td>${params}</td><td>${esc(rivals)}</td></tr>`;
D.causes.slice(0,8).forEach((c,k)=>{const about=c.effects.map(e=>(D.catalogue[e]||{}).summary||"").join("; ");
 html+=rowOf(c.effects.join(" + "),c.probability,`<small>${esc(about)}</small><br>`+c.parameters.map(p=>`${esc(p.name)} ${p.mean===null?"-":(+p.mean).toPrecision(3)} &plusmn; ${p.stdev===null?"-":(+p.stdev).toPrecision(2)} ${esc(p.unit)}`).join(k<2?"<br>":", "),c.confusable_with.concat((c.confusable_with_pairs||[]).map(p=>p.join(" with "))).join(", "))});
html+=rowOf("none: nothing beyond the floor",D.none_probability,"","")+rowOf("unknown: no effect of the catalogue",D.unknown_probability,"","");
$("causes").innerHTML=html;
const sh=D.shrinkage,rows=[[named?sh.effects.join(" + "):"(nothing named)",sh]];
if(sh.best_wrong)rows.push(["for comparison, the best wrong cause: "+sh.best_wrong.effects.join(" + "),sh.best_wrong]);
$("heldout").innerHTML="<tr><th>added</th><th>before</th><th>after</th><th>gone</th><th>95 % interval</th></tr>"+rows.map(([n,s])=>`<tr><td>${esc(n)}</td><td>${num(s.before_rms_mm)} mm</td><td>${num(s.after_rms_mm)} mm</td><td>${s.fraction===null?"-":percent(s.fraction)}</td><td>${s.ci95[0]===null?"-":percent(s.ci95[0])+" to "+percent(s.ci95[1])}</td></tr>`).join("")+`<tr><td colspan=5><small>held out: ${esc(sh.heldout)}</small></td></tr>`;
if(D.ladder.length>1)$("ladder").innerHTML="<h2>Step by step</h2><table>"+D.ladder.map(l=>`<tr><td>${esc((l.effects.length?l.effects.join(" + "):"nominal")+(l.model_error?" + model error":""))}</td><td>${num(l.fitted_rms_mm)} mm fitted</td><td>${num(l.heldout_rms_mm)} mm held out</td></tr>`).join("")+"</table>";
if(D.transfers&&D.transfers.length)$("ladder").innerHTML+="<h2>Other recordings</h2><table>"+D.transfers.map(t=>`<tr><td>fitted on ${esc(t.fitted)}, predicting ${esc(t.predicted)}</td><td>${num(t.before_rms_mm)} mm</td><td>${num(t.after_rms_mm)} mm</td></tr>`).join("")+"</table>";
const I=D.identifiability;
$("overlap").innerHTML="<tr><th></th><th>chi&sup2;</th>"+I.effects.map(e=>`<th class=v>${esc(e)}</th>`).join("")+"</tr>"+I.effects.map((e,c)=>`<tr><th style="text-align:right">${esc(e)}</th><td style="background:${I.visible[c]?"#cfe8d6":"#f2d5d0"}">${I.visibility_chi2[c]===null?"-":(+I.visibility_chi2[c]).toPrecision(2)}</td>`+I.overlap[c].map((v,d)=>{const w=c===d?0:v;return`<td style="background:rgba(180,71,46,${(.9*w).toFixed(2)});color:${w>.6?"#fff":"#333"}">${c===d?"":num(v,2)}</td>`}).join("")+"</tr>").join("");
$("pairs").innerHTML=I.inseparable.length?"<ul>"+I.inseparable.map(p=>`<li>${esc(p.effect)} looks like ${esc(p.stand_in)} (${num(p.overlap)}): ${esc(p.separated_by)}</li>`).join("")+"</ul>":"";
$("absent").textContent=I.not_in_question.length?"Not in question: "+I.not_in_question.map(a=>a.effect+" ("+a.why+")").join("; ")+".":"";
draw();
</script></body></html>
)PAGE";

}  // namespace teres::tools
